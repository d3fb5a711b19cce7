// How much each of the six maps counts for light from one direction; the twin of sixway/shading/blend.py.
//
// Camera (billboard) frame: +x image right, +y image up, +z TOWARDS the viewer. The six maps come as two vectors:
// positive = (right, top, front), negative = (left, bottom, back); a name says where the light COMES FROM.

const int SQUARED = 0;         // w^2, sums to 1 (Unity)
const int PAPER_ABS = 1;       // |w| as the paper's Eq. 5 prints it
const int ABS_NORMALISED = 2;  // |w| / sum (Godot)
const int SMOOTHSTEP = 3;      // 3 w^2 - 2 |w|^3 (EmberGen shaders)

// Weights of the two vectors of maps. to_light: unit vector.
void blend_weights(vec3 to_light, int rule, out vec3 positive, out vec3 negative) {
  vec3 size = abs(to_light);
  vec3 weight = size;
  if (rule == SQUARED) weight = size * size;
  if (rule == ABS_NORMALISED) weight = size / (size.x + size.y + size.z);
  if (rule == SMOOTHSTEP) weight = size * size * (3.0 - 2.0 * size);
  positive = weight * step(0.0, to_light);
  negative = weight - positive;
}

// The weighted sum of the six maps for one light.
float blended(vec3 positive_maps, vec3 negative_maps, vec3 to_light, int rule) {
  vec3 positive, negative;
  blend_weights(to_light, rule, positive, negative);
  return dot(positive, positive_maps) + dot(negative, negative_maps);
}
