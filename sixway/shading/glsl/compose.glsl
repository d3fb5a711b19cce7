// Smoke among other things; the twin of sixway/shading/scene.py and compose.py. Colours linear, premultiplied.

// The part of the smoke's optical depth that lies before a surface at scene_depth_m: smoke begins at smoke_depth_m
// and is as thick as thickness_m.
float part_in_front(float smoke_depth_m, float scene_depth_m, float thickness_m) {
  return clamp((scene_depth_m - smoke_depth_m) / thickness_m, 0.0, 1.0);
}

// Smoke cut off by a surface: colour and alpha (rgba) of that part of it.
vec4 cut_off(vec4 smoke, float part) {
  float alpha = 1.0 - pow(max(1.0 - smoke.a, 0.0), part);
  if (part <= 0.0) alpha = 0.0;
  if (smoke.a >= 1.0 && part > 0.0) alpha = 1.0;
  float share = smoke.a > 1e-5 ? alpha / smoke.a : part;
  return vec4(smoke.rgb * share, alpha);
}

// The smoke in front of a background.
vec3 over(vec4 smoke, vec3 background) {
  return smoke.rgb + (1.0 - smoke.a) * background;
}
