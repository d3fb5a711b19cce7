// Smoke that is not white, and curves over its maps; the twin of sixway/shading/colour.py and remap.py.

const float PI = 3.14159265358979;

// Premultiplied light, dyed by multiplying.
vec3 multiplied(float light, vec3 rgb) {
  return light * rgb;
}

// Premultiplied light, dyed by absorption of strength 0 to 1: what went far through the smoke loses more of what
// the colour lacks (Unity, SixWayLighting.hlsl, in units where a map of 1 is a white surface).
vec3 absorbed(float light, float alpha, vec3 rgb, float strength) {
  float full = (1.0 + clamp(strength, 0.0, 1.0) * (PI - 1.0)) * (alpha > 0.0 ? alpha : 1.0);
  vec3 exponent = 1.0 + log(max(rgb, 1e-5)) / log(0.2);
  float share = clamp(light / full, 0.0, 1.0);
  if (share == 0.0) return vec3(0.0);  // pow(0, x) is undefined in GLSL
  return full * pow(vec3(share), exponent);
}

// Two power curves that meet at pivot: exponent 2^intensity below it, mirrored above. A straight value.
float contrast(float value, float intensity, float pivot) {
  bool above = value > pivot;
  float side = above ? 1.0 - pivot : pivot;
  float away = clamp(above ? 1.0 - value : value, 0.0, 1.0);
  float result = away == 0.0 ? 0.0 : side * pow(away / max(side, 1e-6), exp2(intensity));
  return above ? 1.0 - result : result;
}

// Values from_range become 0 and 1, cut off beyond.
float from_range(float value, vec2 range) {
  return clamp((value - range.x) / (range.y - range.x), 0.0, 1.0);
}
