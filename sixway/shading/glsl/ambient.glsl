// Light from all around; the twin of sixway/shading/ambient.py. Needs colour.glsl.

// Colour that multiplies the map of an axis: 4 pi of directions fall to six maps (Unity's rule).
// mean, slope_x, slope_y, slope_z: RGB of radiance mean + slope . direction, camera frame.
vec3 sky_of_axis(vec3 axis, vec3 mean, vec3 slope_x, vec3 slope_y, vec3 slope_z) {
  return 4.0 / 6.0 * (mean + axis.x * slope_x + axis.y * slope_y + axis.z * slope_z);
}

// The six maps in six colours; maps as in blend.glsl, colours alike: right, top, front, left, bottom, back.
vec3 ambient(vec3 positive_maps, vec3 negative_maps, vec3 skies[6]) {
  return positive_maps.x * skies[0] + positive_maps.y * skies[1] + positive_maps.z * skies[2] +
         negative_maps.x * skies[3] + negative_maps.y * skies[4] + negative_maps.z * skies[5];
}
