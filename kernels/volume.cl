// Samples along rays. Ragged: ray r owns the samples [offsets[r], offsets[r + 1]).
// Every kernel: version 1, a work-item a ray (a chunk of rays on CPU devices).

// Scene coordinates to [0,1]^3. contract: mip-NeRF 360's x -> (2 - 1/|x|) x/|x| with the maximum norm, so that the
// outside of [-1,1]^3 fills the shell up to [-2,2]^3; otherwise [-1,1]^3 itself.
static inline float3 to_unit(float3 p, int contract) {
  const float m = fmax(fabs(p.x), fmax(fabs(p.y), fabs(p.z)));
  if (!contract) return p * 0.5f + 0.5f;
  const float k = m > 1.0f ? (2.0f - 1.0f / m) / m : 1.0f;
  return p * k * 0.25f + 0.5f;
}

static inline int cell_of(float3 u, int side) {
  // Bounds as vectors: Oclgrind 21.10 takes scalar ones of integers for vectors, and reads beyond them.
  const int3 c = clamp(convert_int3(u * (float)side), (int3)(0), (int3)(side - 1));
  return (c.z * side + c.y) * side + c.x;
}

// Steps along each ray, keeps the intervals whose middle lies in a cell above the threshold. span [R,2]: near, far;
// jitter [R]; cells [side^3]: optical thickness of one smallest step. The step grows with distance:
// dt = clamp(t * cone, min_step, max_step).
// scratch [R, capacity] takes the kept t; interval lengths follow from t. counts [R + 1], the last one 0.
FAT __kernel void march(__global const float* restrict origins, __global const float* restrict directions, __global const float* restrict span,
                        __global const float* restrict jitter, __global const float* restrict cells, __global float* restrict scratch,
                        __global int* restrict counts, int rays, int chunk, int side, int contract, int capacity, float min_step, float max_step,
                        float cone, float threshold, int explore) {
  const int end_ray = min(rays, ((int)get_global_id(0) + 1) * chunk);
  for (int r = get_global_id(0) * chunk; r < end_ray; r++) {
    const float3 o = vload3(r, origins), d = vload3(r, directions);
    const float far = span[2 * r + 1];
    int kept = 0;
    float t = span[2 * r];
    t += jitter[r] * clamp(t * cone, min_step, max_step);
    while (t < far && kept < capacity) {
      const float dt = clamp(t * cone, min_step, max_step);
      const int cell = cell_of(to_unit(o + (t + 0.5f * dt) * d, contract), side);
      // One empty cell in 64, others in each step, is looked into all the same: an error of the grid can mend.
      const bool trial = explore != 0 && ((uint)cell * 2654435761u ^ (uint)explore * 2246822519u) >> 26 == 0;
      if (cells[cell] > threshold || trial) scratch[(size_t)r * capacity + kept++] = t;
      t += dt;
    }
    counts[r] = kept;
    if (r == rays - 1) counts[rays] = 0;
  }
}

// How many samples of each ray still receive light: transmittance before them above `least`. counts [R + 1].
FAT __kernel void visible_counts(__global const float* restrict sigma, __global const float* restrict dt, __global const int* restrict offsets,
                                 __global int* restrict counts, int rays, int chunk, float least) {
  const int end_ray = min(rays, ((int)get_global_id(0) + 1) * chunk);
  for (int r = get_global_id(0) * chunk; r < end_ray; r++) {
    float thickness = 0.0f;
    int s = offsets[r];
    const int end = offsets[r + 1];
    const float limit = -m_log(least);
    while (s < end && thickness < limit) {
      thickness += sigma[s] * dt[s];
      s++;
    }
    counts[r] = s - offsets[r];
    if (r == rays - 1) counts[rays] = 0;
  }
}

// The first samples of each ray, packed anew.
FAT __kernel void keep_visible(__global const float* restrict points, __global const float* restrict t, __global const float* restrict dt,
                               __global const int* restrict offsets, __global const int* restrict kept, __global float* restrict points_out,
                               __global float* restrict t_out, __global float* restrict dt_out, __global int* restrict ray_of, int rays,
                               int chunk) {
  const int end_ray = min(rays, ((int)get_global_id(0) + 1) * chunk);
  for (int r = get_global_id(0) * chunk; r < end_ray; r++) {
    const int from = offsets[r], to = kept[r], count = kept[r + 1] - to;
    for (int k = 0; k < count; k++) {
      vstore3(vload3(from + k, points), to + k, points_out);
      t_out[to + k] = t[from + k];
      dt_out[to + k] = dt[from + k];
      ray_of[to + k] = r;
    }
  }
}

// The kept samples side by side: points [S,3] in [0,1]^3, t and dt [S] (t in the middle), ray_of [S].
FAT __kernel void gather_samples(__global const float* restrict origins, __global const float* restrict directions,
                                 __global const float* restrict scratch, __global const int* restrict offsets, __global float* restrict points,
                                 __global float* restrict t_out, __global float* restrict dt_out, __global int* restrict ray_of, int rays,
                                 int chunk, int contract, int capacity, float min_step, float max_step, float cone) {
  const int end_ray = min(rays, ((int)get_global_id(0) + 1) * chunk);
  for (int r = get_global_id(0) * chunk; r < end_ray; r++) {
    const float3 o = vload3(r, origins), d = vload3(r, directions);
    const int begin = offsets[r], count = offsets[r + 1] - begin;
    for (int k = 0; k < count; k++) {
      const float t = scratch[(size_t)r * capacity + k], dt = clamp(t * cone, min_step, max_step), middle = t + 0.5f * dt;
      vstore3(to_unit(o + middle * d, contract), begin + k, points);
      t_out[begin + k] = middle;
      dt_out[begin + k] = dt;
      ray_of[begin + k] = r;
    }
  }
}

// Scene points [S,3] to [0,1]^3.
FAT __kernel void unit_points(__global const float* restrict points, __global float* restrict out, int n, int chunk, int contract) {
  const int end = min(n, ((int)get_global_id(0) + 1) * chunk);
  for (int s = get_global_id(0) * chunk; s < end; s++) vstore3(to_unit(vload3(s, points), contract), s, out);
}

// NeRF's inverse-CDF sampling (section 5.2; bmild/nerf sample_pdf): edges [R, n + 1] ascending, weights [R, n],
// uniform [R, m] ascending -> the n + 1 edges and m new ones merged in order, [R, n + 1 + m].
FAT __kernel void importance_edges(__global const float* restrict edges, __global const float* restrict weights, __global const float* restrict uniform,
                                   __global float* restrict out, int rays, int n, int m, int chunk) {
  const int end_ray = min(rays, ((int)get_global_id(0) + 1) * chunk);
  for (int r = get_global_id(0) * chunk; r < end_ray; r++) {
    __global const float* e = edges + (size_t)r * (n + 1);
    __global const float* w = weights + (size_t)r * n;
    __global const float* u = uniform + (size_t)r * m;
    __global float* to = out + (size_t)r * (n + 1 + m);
    float total = 0.0f;
    for (int i = 0; i < n; i++) total += w[i] + 1e-5f;
    float before = 0.0f;
    int bin = 0, written = 0;
    to[written++] = e[0];
    for (int k = 0; k < m; k++) {
      const float goal = u[k] * total;
      while (bin < n - 1 && before + w[bin] + 1e-5f < goal) {
        before += w[bin] + 1e-5f;
        bin++;
        to[written++] = e[bin];
      }
      const float place = clamp((goal - before) / (w[bin] + 1e-5f), 0.0f, 1.0f);
      to[written++] = e[bin] + place * (e[bin + 1] - e[bin]);
    }
    for (bin++; bin <= n; bin++) to[written++] = e[bin];
  }
}

// Real spherical harmonics up to degree 4 of unit directions [S,3] -> [S,16] (instant-ngp's signs).
FAT __kernel void spherical_harmonics(__global const float* restrict directions, __global float* restrict out, int n, int chunk) {
  const int end = min(n, ((int)get_global_id(0) + 1) * chunk);
  for (int s = get_global_id(0) * chunk; s < end; s++) {
    const float3 d = vload3(s, directions);
    const float x = d.x, y = d.y, z = d.z, xy = x * y, xz = x * z, yz = y * z, x2 = x * x, y2 = y * y, z2 = z * z;
    __global float* h = out + 16 * s;
    h[0] = 0.28209479177387814f;
    h[1] = -0.48860251190291987f * y;
    h[2] = 0.48860251190291987f * z;
    h[3] = -0.48860251190291987f * x;
    h[4] = 1.0925484305920792f * xy;
    h[5] = -1.0925484305920792f * yz;
    h[6] = 0.94617469575755997f * z2 - 0.31539156525251999f;
    h[7] = -1.0925484305920792f * xz;
    h[8] = 0.54627421529603959f * (x2 - y2);
    h[9] = 0.59004358992664352f * y * (-3.0f * x2 + y2);
    h[10] = 2.8906114426405538f * xy * z;
    h[11] = 0.45704579946446572f * y * (1.0f - 5.0f * z2);
    h[12] = 0.3731763325901154f * z * (5.0f * z2 - 3.0f);
    h[13] = 0.45704579946446572f * x * (1.0f - 5.0f * z2);
    h[14] = 1.4453057213202769f * z * (x2 - y2);
    h[15] = 0.59004358992664352f * x * (-x2 + 3.0f * y2);
  }
}

// The cells start, start + stride, ... (modulo side^3; a stride prime to it never repeats one) and a jittered point in
// each, [n,3] in [0,1]^3.
FAT __kernel void occupancy_cells(__global const float* restrict jitter, __global int* restrict cells, __global float* restrict points, int n,
                                  int side, int start, int stride, int chunk) {
  const int all = side * side * side, step = (int)((long)LOOP_STEP * stride % all);
  int c = (int)((start + (long)LOOP_LO(chunk) * stride) % all);
  for (int i = LOOP_LO(chunk); i < LOOP_HI(n, chunk); i += LOOP_STEP) {
    const int row = c / side;
    cells[i] = c;
    const float3 corner = (float3)((float)(c - row * side), (float)(row % side), (float)(row / side));
    vstore3((corner + vload3(i, jitter)) / (float)side, i, points);
    c += c >= all - step ? step - all : step;
  }
}

// Occupancy: estimates of some cells, decayed maxima.
// cells [n] int, density [n]; values [side^3] in place.
FAT __kernel void occupancy_merge(__global const int* restrict cells, __global const float* restrict density, __global float* restrict values, int n, float decay,
                                  int chunk) {
  for (int i = LOOP_LO(chunk); i < LOOP_HI(n, chunk); i += LOOP_STEP) values[cells[i]] = fmax(values[cells[i]] * decay, density[i]);
}
