// A lit sprite: packing "unity", one light of direction, an even sky, fire. The main part of a fragment shader.
// Before it stand: sixway.shading.shader.glsl("blend") and flipbook.glsl.
//
// Frame: to_light is a unit vector TOWARDS the light in the frame of the sprite: +x image right, +y image up,
// +z TOWARDS the viewer. Of a world vector L: vec3(dot(L, right), dot(L, up), dot(L, to_viewer)).
// Units: a map of 1 is a white surface that faces the light. light: what that surface would show, linear RGB; of
// irradiance E it is E / pi. sky: radiance from all around. Divide light and sky by the sidecar's `brightness`, fire
// by its `emissive_brightness`.
// Textures: rtba, lbfe as sRGB formats (R, G, B decoded, A untouched); motion linear. Maps are premultiplied.
// Blend: premultiplied, ONE, ONE_MINUS_SRC_ALPHA, in linear light; encode for display afterwards.

uniform sampler2D rtba, lbfe, motion;
uniform vec2 grid, tile_px, motion_scale;
uniform float time, frames;
uniform bool loops;
uniform vec3 to_light, light, sky, fire;
in vec2 uv;
out vec4 colour;

void main() {
  float frame, next, part;
  vec2 first, second;
  frames_at(time, frames, loops, frame, next, part);
  pushed(motion, uv, frame, next, part, grid, tile_px, motion_scale, first, second);
  vec4 a = mixed(rtba, uv, grid, first, second, part);
  vec4 b = mixed(lbfe, uv, grid, first, second, part);
  vec3 positive = vec3(a.r, a.g, b.b), negative = vec3(b.r, b.g, a.b);  // right, top, front; left, bottom, back
  float even = 4.0 / 6.0 * dot(positive + negative, vec3(1.0));
  colour = vec4(blended(positive, negative, to_light, SQUARED) * light + even * sky + b.a * fire, a.a);
}
