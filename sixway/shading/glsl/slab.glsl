// A lamp in the smoke or near it; the twin of sixway/shading/slab.py and slab_light.py. Needs blend.glsl.
//
// Points in the frame of near.glsl. For each of SLAB_STEPS steps: slab_step says where to ask near.glsl for to_light
// and strength, slab_light what they make of the maps; add up strength * slab_light.

const int SLAB_STEPS = 16;

// Even smoke behind a pixel: metres along the ray, metres, and the optical depth of the whole.
struct Slab {
  float begins_m, thickness_m, optical_depth;
};

// From the mean and standard deviation [m] of the depth that a ray of that opacity sees.
Slab slab_from(float alpha, float mean_m, float spread_m) {
  float x = clamp(-log(max(1.0 - alpha, 1e-9)), 1e-3, 6.0), half_sinh = 0.5 * (exp(0.5 * x) - exp(-0.5 * x));
  bool thin = x < 0.1;
  float mean = thin ? 0.5 - x / 12.0 : 1.0 / x - 1.0 / (exp(x) - 1.0);
  float spread = sqrt(thin ? 1.0 / 12.0 - x * x / 240.0 : 1.0 / (x * x) - 0.25 / (half_sinh * half_sinh));
  float thickness = spread_m / spread;
  return Slab(mean_m - mean * thickness, thickness, x);
}

// Extinction [1/m] between a pixel's smoke and a lamp. at_lamp: of the smoke there, as slab_light.py finds it.
float extinction_to(Slab slab, float alpha, float at_lamp) {
  return (alpha * slab.optical_depth / slab.thickness_m + at_lamp) / (alpha + 1.0);
}

// That of the pixel that shows the lamp, or the picture's mean as far as there is no smoke. lamp: opacity, and opacity
// times extinction, between texels; 0 outside the picture. mean: sum of the latter over the sum of the former.
float extinction_at_lamp(vec2 lamp, float mean) {
  return lamp.y + (1.0 - lamp.x) * mean;
}

// Where on the ray step number n lies, and its part of the maps: x of those from the sides, y front, z back.
// focus: the part of the lamp that is nearest to the middle of the slab. towards: of the ray, unit.
void slab_step(Slab slab, vec3 origin, vec3 towards, vec3 focus, int n, out float at_m, out vec3 shares) {
  float deep = slab.thickness_m, foot = dot(focus - origin, towards);
  float miss = length(focus - origin - foot * towards);
  foot -= slab.begins_m;
  float scale = max(max(miss, 0.01 * deep), max(-foot, foot - deep));
  float first = atan(-foot / scale), last = atan((deep - foot) / scale);
  vec3 angle = first + (last - first) * (float(n) + vec3(0.0, 0.5, 1.0)) / float(SLAB_STEPS);
  vec3 place = clamp(foot + scale * tan(angle), 0.0, deep);
  if (n == 0) place.x = 0.0;
  if (n == SLAB_STEPS - 1) place.z = deep;
  float seen = exp(-slab.optical_depth * place.x / deep), left = exp(-slab.optical_depth * place.z / deep);
  float through = exp(-slab.optical_depth), side = (seen - left) / (1.0 - through);
  at_m = slab.begins_m + place.y;
  shares = vec3(side, side * (seen + left) / (1.0 + through), (place.z - place.x) / deep);
}

// M = pi L / E of opaque smoke whose light has come through that much even smoke; isotropic.
float map_in_smoke(float optical_depth, float alpha, float albedo) {
  return 0.25 * albedo * exp(-optical_depth) * (1.0 + albedo * alpha * (1.0 - exp(-2.0 * optical_depth)));
}

// What a step adds to the lamp's map, per strength. to_light: camera frame. optical_depth: extinction_to times the
// metres from the step to the nearest part of the lamp. albedo: of the smoke, 1 for white.
float slab_light(vec3 positive_maps, vec3 negative_maps, float alpha, vec3 shares, vec3 to_light, int rule,
                 float optical_depth, float albedo) {
  float mixed = blended(positive_maps * shares.xxy, negative_maps * shares.xxz, to_light, rule);
  return max(mixed, alpha * shares.x * map_in_smoke(optical_depth, alpha, albedo));
}
