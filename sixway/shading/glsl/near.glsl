// What arrives at a point from a lamp; the twin of sixway/shading/near.py.
//
// Points and vectors in one frame of your choice, metres. Each function gives the unit vector towards the light and
// the strength that its colour is to be multiplied by: irradiance of a plane that faces it. Turn to_light into the
// camera frame before blend_weights, and divide colour times strength by pi: maps are M = pi L / E. A lamp without
// an end has range_m = 0.

// Fades the inverse square to 0 at range_m (Karis 2013).
float window(float distance_m, float range_m) {
  if (range_m <= 0.0) return 1.0;
  float share = distance_m / range_m;
  float rest = max(1.0 - share * share * share * share, 0.0);
  return rest * rest;
}

// At length 1; where light comes from all around any direction will do.
vec3 normalised(vec3 vector) {
  float size = length(vector);
  return size > 1e-9 ? vector / size : vec3(0.0, 0.0, 1.0);
}

// intensity per steradian
void from_point(vec3 point, vec3 position, float radius_m, float range_m, out vec3 to_light, out float strength) {
  vec3 offset = position - point;
  float distance_m = length(offset);
  float near = max(distance_m, radius_m);
  to_light = normalised(offset);
  strength = window(distance_m, range_m) / (near * near);
}

// intensity on the axis; full up to beam, falling linearly with the angle to cutoff [radians from the axis]
void from_spot(vec3 point, vec3 position, vec3 towards, float cutoff, float beam, float radius_m, float range_m,
               out vec3 to_light, out float strength) {
  from_point(point, position, radius_m, range_m, to_light, strength);
  float angle = acos(clamp(-dot(to_light, towards), -1.0, 1.0));
  strength *= clamp((cutoff - angle) / (cutoff - beam), 0.0, 1.0);
}

// intensity of the whole wire; its light falls evenly on the angle that it is seen under
void from_line(vec3 point, vec3 start, vec3 end, float radius_m, float range_m, out vec3 to_light,
               out float strength) {
  vec3 a = start - point, b = end - point;
  float length_a = max(length(a), radius_m), length_b = max(length(b), radius_m);
  float across = max(length(cross(a, b)), radius_m * distance(start, end));
  to_light = normalised(a / length_a + b / length_b);
  strength = atan(across, dot(a, b)) / across * window(min(length_a, length_b), range_m);
}

float triangle_solid_angle(vec3 a, vec3 b, vec3 c) {  // Van Oosterom, Strackee 1983
  return abs(2.0 * atan(dot(a, cross(b, c)), 1.0 + dot(a, b) + dot(b, c) + dot(c, a)));
}

vec3 edge_irradiance(vec3 first, vec3 second) {  // Lambert
  vec3 normal = cross(second, first);
  float sine = length(normal);
  return atan(sine, dot(first, second)) / max(sine, 1e-7) * normal;
}

vec3 along_edge(vec3 centre, vec3 half_edge) {
  return clamp(dot(centre, half_edge) / dot(half_edge, half_edge), -1.0, 1.0) * half_edge;
}

// The part of a lamp that is nearest to a point.
vec3 nearest_on_line(vec3 point, vec3 start, vec3 end) {
  vec3 half_line = 0.5 * (end - start), middle = start + half_line;
  return middle + along_edge(point - middle, half_line);
}

vec3 nearest_on_rectangle(vec3 point, vec3 centre, vec3 half_right, vec3 half_up) {
  return centre + along_edge(point - centre, half_right) + along_edge(point - centre, half_up);
}

// radiance; half_right and half_up from the centre to the middles of two edges, right x up is where it shines
void from_rectangle(vec3 point, vec3 centre, vec3 half_right, vec3 half_up, float range_m, out vec3 to_light,
                    out float strength) {
  vec3 middle = centre - point;
  vec3 a = normalised(middle - half_right - half_up), b = normalised(middle + half_right - half_up);
  vec3 c = normalised(middle + half_right + half_up), d = normalised(middle - half_right + half_up);
  to_light = normalised(edge_irradiance(a, b) + edge_irradiance(b, c) + edge_irradiance(c, d) + edge_irradiance(d, a));
  strength = triangle_solid_angle(a, b, c) + triangle_solid_angle(a, c, d);
  if (dot(middle, cross(half_right, half_up)) >= 0.0) strength = 0.0;
  vec3 nearest = middle - along_edge(middle, half_right) - along_edge(middle, half_up);
  strength *= window(length(nearest), range_m);
}
