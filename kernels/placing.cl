// Things where they stand, as a camera sees them, and gaussians' colours at a time. version 1.
// Poses [N,3,4]: world_from_thing, as given. Of a table of shifts [B,3] (in the thing's axes) and turns [B] (about its z
// axis) each thing takes `shares` [N,2] of two `rows` [N,2]: it stands at pose * (shift, turn), its x axis times `sides` [N], which
// are 1, or -1 for a thing that is mirrored. view [3,4]: camera_from_world.
typedef struct {
  float given[3][3], turned[3][3];  // world_from_thing
  float away[3];                    // from the thing to the eye, in the world
  float at[3];
} Stand;

static inline Stand stand(__global const float* pose, __global const float* shifts, __global const float* turns,
                          __global const int* rows, __global const float* shares, float side, __global const float* view,
                          int table) {
  Stand o;
  float by[3] = {0, 0, 0}, turn = 0;
  for (int j = 0; j < 2; j++) {
    const int row = clamp(rows[j], 0, table - 1);
    for (int k = 0; k < 3; k++) by[k] += shares[j] * shifts[3 * row + k];
    turn += shares[j] * turns[row];
  }
  const float c = m_cos(turn), s = m_sin(turn);
  for (int i = 0; i < 3; i++) {
    for (int k = 0; k < 3; k++) o.given[i][k] = pose[4 * i + k];
    o.turned[i][0] = side * (c * o.given[i][0] + s * o.given[i][1]);
    o.turned[i][1] = c * o.given[i][1] - s * o.given[i][0];
    o.turned[i][2] = o.given[i][2];
    o.at[i] = pose[4 * i + 3] + o.given[i][0] * by[0] + o.given[i][1] * by[1] + o.given[i][2] * by[2];
  }
  for (int k = 0; k < 3; k++) o.away[k] = -(view[k] * view[3] + view[4 + k] * view[7] + view[8 + k] * view[11]) - o.at[k];
  return o;
}

// out [N,15]: camera_from_thing row by row, then the eye in the thing's axes.
__kernel FAT void place_things(__global const float* restrict poses, __global const float* restrict shifts,
                               __global const float* restrict turns, __global const int* restrict rows,
                               __global const float* restrict shares, __global const float* restrict sides,
                               __global const float* restrict view,
                               __global float* restrict out, int count, int table, int chunk) {
  for (int n = LOOP_LO(chunk); n < LOOP_HI(count, chunk); n += LOOP_STEP) {
    const Stand o = stand(poses + 12 * n, shifts, turns, rows + 2 * n, shares + 2 * n, sides[n], view, table);
    __global float* to = out + 15 * n;
    for (int i = 0; i < 3; i++) {
      for (int k = 0; k < 3; k++)
        to[4 * i + k] = view[4 * i] * o.turned[0][k] + view[4 * i + 1] * o.turned[1][k] + view[4 * i + 2] * o.turned[2][k];
      to[4 * i + 3] = view[4 * i + 3] + view[4 * i] * o.at[0] + view[4 * i + 1] * o.at[1] + view[4 * i + 2] * o.at[2];
      to[12 + i] = o.turned[0][i] * o.away[0] + o.turned[1][i] * o.away[1] + o.turned[2][i] * o.away[2];
    }
  }
}

// out [N,2,4]: by the shift and the turn of each of the two rows.
__kernel FAT void place_things_grad(__global const float* restrict poses, __global const float* restrict shifts,
                                    __global const float* restrict turns, __global const int* restrict rows,
                                    __global const float* restrict shares, __global const float* restrict sides,
                               __global const float* restrict view,
                                    __global const float* restrict g, __global float* restrict out, int count, int table,
                                    int chunk) {
  for (int n = LOOP_LO(chunk); n < LOOP_HI(count, chunk); n += LOOP_STEP) {
    const Stand o = stand(poses + 12 * n, shifts, turns, rows + 2 * n, shares + 2 * n, sides[n], view, table);
    __global const float* from = g + 15 * n;
    float by_at[3], by_turn = 0;
    for (int i = 0; i < 3; i++) {
      by_at[i] = view[i] * from[3] + view[4 + i] * from[7] + view[8 + i] * from[11];
      for (int k = 0; k < 3; k++) by_at[i] -= o.turned[i][k] * from[12 + k];
      const float by_x = view[i] * from[0] + view[4 + i] * from[4] + view[8 + i] * from[8] + o.away[i] * from[12];
      const float by_y = view[i] * from[1] + view[4 + i] * from[5] + view[8 + i] * from[9] + o.away[i] * from[13];
      by_turn += sides[n] * (by_x * o.turned[i][1] - by_y * o.turned[i][0]);
    }
    for (int j = 0; j < 2; j++) {
      __global float* to = out + 8 * n + 4 * j;
      const float share = shares[2 * n + j];
      for (int k = 0; k < 3; k++)
        to[k] = share * (o.given[0][k] * by_at[0] + o.given[1][k] * by_at[1] + o.given[2][k] * by_at[2]);
      to[3] = share * by_turn;
    }
  }
}

// out [G,3] = first [G,3] + the sum over W of amplitudes [G,W,3] * heights [N,W] of the gaussian's owner.
__kernel FAT void add_waves(__global const float* restrict first, __global const float* restrict amplitudes,
                            __global const float* restrict heights, __global const int* restrict owners,
                            __global float* restrict out, int count, int waves, int things, int chunk) {
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) {
    __global const float* height = heights + (size_t)clamp(owners[i], 0, things - 1) * waves;
    __global const float* from = amplitudes + (size_t)i * waves * 3;
    float r = first[3 * i], g = first[3 * i + 1], b = first[3 * i + 2];
    for (int w = 0; w < waves; w++) {
      r += from[3 * w] * height[w];
      g += from[3 * w + 1] * height[w];
      b += from[3 * w + 2] * height[w];
    }
    out[3 * i] = r, out[3 * i + 1] = g, out[3 * i + 2] = b;
  }
}

// out [G,W,3] = g [G,3] * heights.
__kernel FAT void add_waves_grad(__global const float* restrict heights, __global const int* restrict owners,
                                 __global const float* restrict g, __global float* restrict out, int count, int waves,
                                 int things, int chunk) {
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) {
    __global const float* height = heights + (size_t)clamp(owners[i], 0, things - 1) * waves;
    __global float* to = out + (size_t)i * waves * 3;
    for (int w = 0; w < waves; w++)
      for (int c = 0; c < 3; c++) to[3 * w + c] = g[3 * i + c] * height[w];
  }
}
