// A lit six-way sprite for Unreal: paste this into a Custom node (output CMOT Float 4). Packing "unity".
//
// Inputs: RTBA, LBFE, MV (Texture Objects); UV, Grid, TilePx, MotionScale (2); Time, Frames, Loops (1); ToLight, Right,
// Up, ToViewer, LightColour, Sky, Fire (3).
// Frame: ToLight, Right, Up, ToViewer are unit vectors in one space, say world: TOWARDS the light, image right, image
// up, TOWARDS the viewer. For a sprite that faces the camera the last three are (1,0,0), (0,1,0), (0,0,-1) through
// Transform Vector, View Space to World Space. Only dot products follow: left-handed axes and centimetres do not matter.
// Units: a map of 1 is a white surface that faces the light. LightColour is what that surface shows: illuminance [lux]
// x colour / PI. Sky: radiance from all around. Divide LightColour and Sky by the sidecar's brightness, Fire by its
// emissive_brightness.
// Textures: RTBA and LBFE with sRGB on (A is linear all the same), compression BC7; MV with sRGB OFF and compression
// VectorDisplacementmap (RGBA8), no mips. v points down: where the sidecar says "y": "up", MotionScale is
// (scale, -scale), else (scale, scale).
// Material: Unlit, Translucent, blend mode AlphaComposite (premultiplied): rgb to Emissive Color, a to Opacity.

float clock = Loops > 0.5 ? Time - Frames * floor(Time / Frames) : clamp(Time, 0.0, Frames - 1.0);
float frame = min(floor(clock), Frames - 1.0);
float next = frame + 1.0;
if (next >= Frames) next = Loops > 0.5 ? 0.0 : frame;
float part = clock - frame;
float2 margin = 0.5 / TilePx;
float2 tile0 = float2(frame - Grid.x * floor((frame + 0.5) / Grid.x), floor((frame + 0.5) / Grid.x));
float2 tile1 = float2(next - Grid.x * floor((next + 0.5) / Grid.x), floor((next + 0.5) / Grid.x));
float2 dx = ddx(UV) / Grid;
float2 dy = ddy(UV) / Grid;
float2 here = clamp(UV, margin, 1.0 - margin);
float2 ahead = 2.0 * MV.SampleGrad(MVSampler, (tile0 + here) / Grid, dx, dy).rg - 1.0;
float2 behind = 2.0 * MV.SampleGrad(MVSampler, (tile1 + here) / Grid, dx, dy).rg - 1.0;
float2 first = (tile0 + clamp(UV - part * MotionScale * ahead, margin, 1.0 - margin)) / Grid;
float2 second = (tile1 + clamp(UV + (1.0 - part) * MotionScale * behind, margin, 1.0 - margin)) / Grid;
float4 a = lerp(RTBA.SampleGrad(RTBASampler, first, dx, dy), RTBA.SampleGrad(RTBASampler, second, dx, dy), part);
float4 b = lerp(LBFE.SampleGrad(LBFESampler, first, dx, dy), LBFE.SampleGrad(LBFESampler, second, dx, dy), part);
float3 positive = float3(a.r, a.g, b.b); // right, top, front
float3 negative = float3(b.r, b.g, a.b); // left, bottom, back
float3 l = float3(dot(ToLight, Right), dot(ToLight, Up), dot(ToLight, ToViewer));
float3 maps = lerp(negative, positive, step(float3(0.0, 0.0, 0.0), l));
float even = 4.0 / 6.0 * dot(positive + negative, float3(1.0, 1.0, 1.0));
return float4(dot(l * l, maps) * LightColour + even * Sky + b.a * Fire, a.a);
