// Flipbooks with motion vectors: two frames pushed towards each other and mixed; the twin of sixway/engines/motion.py.
// GLSL ES 3.00. Texture row 0 lies at v = 0 (v points down, as the picture is stored).
//
// grid: columns and rows of tiles, frame 0 top left, row by row. tile_px: width and height of a tile.
// motion: linear (sRGB off), 0.5 is no motion. motion_scale: `motion.scale` of the sidecar, twice; its y is negative
// where the sidecar says "y": "up", since v points down here.

// Where uv of one tile lies in the book; it stays half a texel away from the neighbours.
vec2 in_tile(vec2 uv, float frame, vec2 grid, vec2 tile_px) {
  float row = floor((frame + 0.5) / grid.x);
  vec2 inside = clamp(uv, 0.5 / tile_px, 1.0 - 0.5 / tile_px);
  return (vec2(frame - row * grid.x, row) + inside) / grid;
}

// The frames before and after a time [frames], and the part of the way between them. A book that loops goes on from
// its last frame to its first; another one stops there.
void frames_at(float time, float frames, bool loops, out float frame, out float next, out float part) {
  float clock = loops ? mod(time, frames) : clamp(time, 0.0, frames - 1.0);
  frame = min(floor(clock), frames - 1.0);
  next = frame + 1.0;
  if (next >= frames) next = loops ? 0.0 : frame;
  part = clock - frame;
}

// Places in the book of uv in both frames, each pushed to the moment between them: first -t v, second +(1 - t) v.
void pushed(sampler2D motion, vec2 uv, float frame, float next, float part, vec2 grid, vec2 tile_px, vec2 motion_scale,
            out vec2 first, out vec2 second) {
  vec2 right = dFdx(uv) / grid, down = dFdy(uv) / grid;  // of the whole sprite: tiles have seams, uv has none
  vec2 ahead = 2.0 * textureGrad(motion, in_tile(uv, frame, grid, tile_px), right, down).rg - 1.0;
  vec2 behind = 2.0 * textureGrad(motion, in_tile(uv, next, grid, tile_px), right, down).rg - 1.0;
  first = in_tile(uv - part * motion_scale * ahead, frame, grid, tile_px);
  second = in_tile(uv + (1.0 - part) * motion_scale * behind, next, grid, tile_px);
}

// The two places of a texture, mixed. uv: of the tile, for its derivatives.
vec4 mixed(sampler2D book, vec2 uv, vec2 grid, vec2 first, vec2 second, float part) {
  vec2 right = dFdx(uv) / grid, down = dFdy(uv) / grid;
  return mix(textureGrad(book, first, right, down), textureGrad(book, second, right, down), part);
}
