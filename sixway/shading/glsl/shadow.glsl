// Whether a point lies behind a solid, as the light sees it; the twin of sixway/shading/shadow_map.py.

const int SHADOW_TAPS = 24;

// 1 where the texel's solid is nearer than the limit. pixel: in texels of the map, centres at halves.
float blocked(sampler2D shadow, vec2 pixel, float limit, out float depth) {
  ivec2 size = textureSize(shadow, 0);
  bool inside = all(greaterThanEqual(pixel, vec2(0.0))) && all(lessThan(pixel, vec2(size)));
  depth = texelFetch(shadow, inside ? ivec2(pixel) : ivec2(0), 0).r;
  return inside && depth < limit ? 1.0 : 0.0;
}

// Blocked part of a disc of that many texels across.
float filtered(sampler2D shadow, vec2 pixel, float limit, float width_px, out float blocker) {
  float hits = 0.0, depths = 0.0, depth;
  for (int tap = 0; tap < SHADOW_TAPS; ++tap) {  // Vogel's spiral
    float radius = sqrt((float(tap) + 0.5) / float(SHADOW_TAPS)), turn = 2.39996322972865 * float(tap);
    float hit = blocked(shadow, pixel + 0.5 * radius * width_px * vec2(cos(turn), sin(turn)), limit, depth);
    hits += hit;
    depths += hit > 0.0 ? depth : 0.0;
  }
  blocker = hits > 0.0 ? depths / hits : -1.0;
  return hits / float(SHADOW_TAPS);
}

// The part of a sun that a point sees past the solids, softened over softness_m and the sun's own width.
// shadow: depths [m] along the rays of an orthographic light camera, large where there is no solid, row 0 on top.
// pixel, depth: of the point in it. light_size: 2 tan(angle / 2). texel_m: of the map. nearest_m: its least depth.
float visible_point(sampler2D shadow, vec2 pixel, float depth, float light_size, float softness_m, float texel_m,
                    float nearest_m) {
  float limit = depth - 1.5 * texel_m, blocker;
  if (light_size == 0.0 && softness_m == 0.0) return 1.0 - blocked(shadow, pixel, limit, blocker);
  float search = light_size * max(depth - nearest_m, 0.0) + softness_m;
  if (filtered(shadow, pixel, limit, search / texel_m, blocker) == 0.0) return 1.0;
  float width = light_size * max(depth - blocker, 0.0) + softness_m;
  return 1.0 - filtered(shadow, pixel, limit, width / texel_m, blocker);
}
