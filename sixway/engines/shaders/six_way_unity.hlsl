// A lit six-way sprite for Unity's Shader Graph (Custom Function node, type File): packing "unity", one light, an even
// sky, fire. (VFX Graph has the same built in: Output Particle Six-way Smoke Lit, UV mode Flipbook Motion Blend.)
//
// Frame: ToLight, Right, Up, ToViewer are unit vectors in world space: TOWARDS the light (GetMainLight().direction is
// that already; a light's forward is the opposite), and the sprite's image right, image up and TOWARDS the viewer.
// Units: a map of 1 is a white surface that faces the light. LightColour is what that surface shows: URP's light
// colour x attenuations; in HDRP illuminance / PI. Sky: radiance from all around. Divide LightColour and Sky by the
// sidecar's brightness, Fire by its emissive_brightness.
// Textures: RTBA and LBFE with sRGB on (R, G, B decoded, A is linear all the same); MV with sRGB OFF, no compression,
// no mips. Wrap clamp. UV runs 0 to 1 over the sprite, v UP as in Unity. MotionScale: the sidecar's scale, twice; its y
// negative only where the sidecar says "y": "down".
// Output: Colour is PREMULTIPLIED: unlit, transparent, blending mode Premultiply. If the rim of the smoke looks dark,
// the pipeline multiplies by Alpha once more: wire Colour / max(Alpha, 1 / 255) instead.

#ifndef SIX_WAY_UNITY
#define SIX_WAY_UNITY

float2 SixWayInTile(float2 uv, float frame, float2 grid, float2 tilePx)
{
    float row = floor((frame + 0.5) / grid.x);
    float2 inside = clamp(uv, 0.5 / tilePx, 1.0 - 0.5 / tilePx);
    return (float2(frame - row * grid.x, grid.y - 1.0 - row) + inside) / grid; // v is up: the first row is the highest
}

void SixWaySprite_float(
    UnityTexture2D RTBA, UnityTexture2D LBFE, UnityTexture2D MV, float2 UV, float2 Grid, float2 TilePx,
    float2 MotionScale, float Time, float Frames, float Loops, float3 ToLight, float3 Right, float3 Up, float3 ToViewer,
    float3 LightColour, float3 Sky, float3 Fire, out float3 Colour, out float Alpha)
{
    float clock = Loops > 0.5 ? Time - Frames * floor(Time / Frames) : clamp(Time, 0.0, Frames - 1.0);
    float frame = min(floor(clock), Frames - 1.0);
    float next = frame + 1.0;
    if (next >= Frames) next = Loops > 0.5 ? 0.0 : frame;
    float part = clock - frame;
    float2 dx = ddx(UV) / Grid;
    float2 dy = ddy(UV) / Grid;
    float2 hereA = SixWayInTile(UV, frame, Grid, TilePx);
    float2 hereB = SixWayInTile(UV, next, Grid, TilePx);
    float2 ahead = 2.0 * SAMPLE_TEXTURE2D_GRAD(MV.tex, MV.samplerstate, hereA, dx, dy).rg - 1.0;
    float2 behind = 2.0 * SAMPLE_TEXTURE2D_GRAD(MV.tex, MV.samplerstate, hereB, dx, dy).rg - 1.0;
    float2 first = SixWayInTile(UV - part * MotionScale * ahead, frame, Grid, TilePx);
    float2 second = SixWayInTile(UV + (1.0 - part) * MotionScale * behind, next, Grid, TilePx);
    float4 a = lerp(SAMPLE_TEXTURE2D_GRAD(RTBA.tex, RTBA.samplerstate, first, dx, dy),
                    SAMPLE_TEXTURE2D_GRAD(RTBA.tex, RTBA.samplerstate, second, dx, dy), part);
    float4 b = lerp(SAMPLE_TEXTURE2D_GRAD(LBFE.tex, LBFE.samplerstate, first, dx, dy),
                    SAMPLE_TEXTURE2D_GRAD(LBFE.tex, LBFE.samplerstate, second, dx, dy), part);
    float3 positive = float3(a.r, a.g, b.b); // right, top, front
    float3 negative = float3(b.r, b.g, a.b); // left, bottom, back
    float3 l = float3(dot(ToLight, Right), dot(ToLight, Up), dot(ToLight, ToViewer));
    float3 maps = lerp(negative, positive, step(float3(0.0, 0.0, 0.0), l));
    float even = 4.0 / 6.0 * dot(positive + negative, float3(1.0, 1.0, 1.0));
    Colour = dot(l * l, maps) * LightColour + even * Sky + b.a * Fire;
    Alpha = a.a;
}

#endif
