// 3D Gaussians as a pinhole camera sees them (Kerbl et al. 2023, section 4; Zwicker et al. 2001, EWA splatting), and
// their colours from spherical harmonics. Raw parameters: deviations exp(scales), opacities sigmoid(logits), quaternions
// of any length.
//   t = W m + T,  N = W R S,  P = J N,  cov = P P' + blur I,  conic = cov^-1
// with J the derivative of the projection at t, whose slopes are held to the picture and 0.3 of its half width around.
// views [N,3,4]: W and T of each owner (owned: owners [G] in [0,N), else all see the first), then lens [6]: fx, fy, cx, cy,
// width, height. Gaussians at z <= near get opacity 0.
// antialiased: opacity times sqrt(det(cov - blur I) / det cov) (Yu et al. 2024, Mip-Splatting).
typedef struct {
  float w[3][3];             // camera_from_world
  float t[3], slope[2];      // the mean in the camera's axes; tx / z and ty / z, held
  int held[2];
  float r[3][3], s[3], q[4], length;  // rotation, deviations, unit quaternion
  float n[3][3], p[2][3];
  float xx, xy, yy, det, det_sharp;   // covariance with blur
  int seen;
} Seen;

static inline Seen look(__global const float* mean, __global const float* scale, __global const float* rotation,
                        __global const float* view, __global const float* lens, float blur, float near) {
  Seen o;
  const float fx = lens[0], fy = lens[1];
  for (int i = 0; i < 3; i++) {
    for (int j = 0; j < 3; j++) o.w[i][j] = view[4 * i + j];
    o.t[i] = o.w[i][0] * mean[0] + o.w[i][1] * mean[1] + o.w[i][2] * mean[2] + view[4 * i + 3];
  }
  o.seen = o.t[2] > near;
  if (!o.seen) return o;
  const float z = o.t[2];
  for (int i = 0; i < 2; i++) {
    const float f = lens[i], c = lens[2 + i], size = lens[4 + i], more = 0.15f * size / f;
    const float exact = o.t[i] / z;
    o.slope[i] = clamp(exact, -c / f - more, (size - c) / f + more);
    o.held[i] = o.slope[i] != exact;
  }
  o.length = sqrt(rotation[0] * rotation[0] + rotation[1] * rotation[1] + rotation[2] * rotation[2] + rotation[3] * rotation[3]);
  o.length = fmax(o.length, 1e-12f);
  for (int i = 0; i < 4; i++) o.q[i] = rotation[i] / o.length;
  const float w = o.q[0], x = o.q[1], y = o.q[2], v = o.q[3];
  o.r[0][0] = 1.0f - 2.0f * (y * y + v * v), o.r[0][1] = 2.0f * (x * y - w * v), o.r[0][2] = 2.0f * (x * v + w * y);
  o.r[1][0] = 2.0f * (x * y + w * v), o.r[1][1] = 1.0f - 2.0f * (x * x + v * v), o.r[1][2] = 2.0f * (y * v - w * x);
  o.r[2][0] = 2.0f * (x * v - w * y), o.r[2][1] = 2.0f * (y * v + w * x), o.r[2][2] = 1.0f - 2.0f * (x * x + y * y);
  for (int k = 0; k < 3; k++) o.s[k] = m_exp(scale[k]);
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++)
      o.n[i][k] = (o.w[i][0] * o.r[0][k] + o.w[i][1] * o.r[1][k] + o.w[i][2] * o.r[2][k]) * o.s[k];
  for (int k = 0; k < 3; k++) {
    o.p[0][k] = fx / z * (o.n[0][k] - o.slope[0] * o.n[2][k]);
    o.p[1][k] = fy / z * (o.n[1][k] - o.slope[1] * o.n[2][k]);
  }
  const float xx = o.p[0][0] * o.p[0][0] + o.p[0][1] * o.p[0][1] + o.p[0][2] * o.p[0][2];
  const float yy = o.p[1][0] * o.p[1][0] + o.p[1][1] * o.p[1][1] + o.p[1][2] * o.p[1][2];
  o.xy = o.p[0][0] * o.p[1][0] + o.p[0][1] * o.p[1][1] + o.p[0][2] * o.p[1][2];
  o.xx = xx + blur, o.yy = yy + blur;
  // Without cancellation: of a needle the determinant is a small difference of large products (Lagrange's identity).
  const float u = o.p[0][1] * o.p[1][2] - o.p[0][2] * o.p[1][1], e = o.p[0][2] * o.p[1][0] - o.p[0][0] * o.p[1][2];
  const float d = o.p[0][0] * o.p[1][1] - o.p[0][1] * o.p[1][0];
  o.det_sharp = u * u + e * e + d * d;
  o.det = o.det_sharp + blur * (xx + yy + blur);
  o.seen = o.det > 0.0f && isfinite(o.det);
  return o;
}

static inline float sharpness(Seen o, int antialiased) { return antialiased ? sqrt(fmax(o.det_sharp / o.det, 2.5e-5f)) : 1.0f; }

// out [G,7]: x, y in pixels, conic a, b, c, opacity, depth z.
__kernel FAT void project(__global const float* restrict means, __global const float* restrict scales,
                          __global const float* restrict rotations, __global const float* restrict logits,
                          __global const float* restrict views, __global const int* restrict owners, int owned,
                          __global const float* restrict lens, __global float* restrict out, int count, float blur,
                          float near, int antialiased, int chunk) {
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) {
    __global float* to = out + 7 * (size_t)i;
    __global const float* view = views + 12 * (owned ? owners[i] : 0);
    const Seen o = look(means + 3 * (size_t)i, scales + 3 * (size_t)i, rotations + 4 * (size_t)i, view, lens, blur, near);
    if (!o.seen) {
      to[0] = to[1] = to[3] = to[5] = to[6] = 0.0f;
      to[2] = to[4] = 1.0f;
      continue;
    }
    to[0] = lens[0] * o.t[0] / o.t[2] + lens[2];
    to[1] = lens[1] * o.t[1] / o.t[2] + lens[3];
    to[2] = o.yy / o.det;
    to[3] = -o.xy / o.det;
    to[4] = o.xx / o.det;
    to[5] = m_sigmoid(logits[i]) * sharpness(o, antialiased);
    to[6] = o.t[2];
  }
}

// d loss / d r, by quaternion (unit, then by its length).
static inline void turn_back(Seen o, float g[3][3], __global float* to) {
  const float w = o.q[0], x = o.q[1], y = o.q[2], z = o.q[3];
  float d[4];
  d[0] = 2.0f * (x * (g[2][1] - g[1][2]) + y * (g[0][2] - g[2][0]) + z * (g[1][0] - g[0][1]));
  d[1] = 2.0f * (-2.0f * x * (g[1][1] + g[2][2]) + y * (g[0][1] + g[1][0]) + z * (g[0][2] + g[2][0]) + w * (g[2][1] - g[1][2]));
  d[2] = 2.0f * (x * (g[0][1] + g[1][0]) - 2.0f * y * (g[0][0] + g[2][2]) + z * (g[1][2] + g[2][1]) + w * (g[0][2] - g[2][0]));
  d[3] = 2.0f * (x * (g[0][2] + g[2][0]) + y * (g[1][2] + g[2][1]) - 2.0f * z * (g[0][0] + g[1][1]) + w * (g[1][0] - g[0][1]));
  const float along = d[0] * w + d[1] * x + d[2] * y + d[3] * z;
  for (int i = 0; i < 4; i++) to[i] = (d[i] - along * o.q[i]) / o.length;
}

// g [G,7] -> out [G,11]: mean 3, scale 3, rotation 4, logit; with_pose: [G,23], then its view's W and T [3,4] as well.
__kernel FAT void project_grad(__global const float* restrict means, __global const float* restrict scales,
                               __global const float* restrict rotations, __global const float* restrict logits,
                               __global const float* restrict views, __global const int* restrict owners, int owned,
                               __global const float* restrict lens, __global const float* restrict gradient,
                               __global float* restrict out, int count, float blur, float near, int antialiased,
                               int with_pose, int chunk) {
  const int width = with_pose ? 23 : 11;
  const float f[2] = {lens[0], lens[1]};
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) {
    __global float* to = out + width * (size_t)i;
    __global const float* g = gradient + 7 * (size_t)i;
    __global const float* view = views + 12 * (owned ? owners[i] : 0);
    const Seen o = look(means + 3 * (size_t)i, scales + 3 * (size_t)i, rotations + 4 * (size_t)i, view, lens, blur, near);
    const int reached = g[0] != 0.0f || g[1] != 0.0f || g[2] != 0.0f || g[3] != 0.0f || g[4] != 0.0f || g[5] != 0.0f || g[6] != 0.0f;
    if (!o.seen || !reached) {
      for (int k = 0; k < width; k++) to[k] = 0.0f;
      continue;
    }
    const float opacity = m_sigmoid(logits[i]), sharp = sharpness(o, antialiased), z = o.t[2];
    to[10] = g[5] * sharp * opacity * (1.0f - opacity);
    // by the covariance: -Q gQ Q, where gQ = (ga, gb / 2; gb / 2, gc)
    const float a = o.yy / o.det, b = -o.xy / o.det, c = o.xx / o.det, half_b = 0.5f * g[3];
    const float ma = a * g[2] + b * half_b, mb = a * half_b + b * g[4], mc = b * g[2] + c * half_b, md = b * half_b + c * g[4];
    float gxx = -(ma * a + mb * b), gxy = -(ma * b + mb * c), gyy = -(mc * b + md * c);
    float sharp_part = 0.0f;  // d loss / d det_sharp
    if (antialiased && o.det_sharp / o.det > 2.5e-5f) {
      const float by_ratio = 0.5f * g[5] * opacity / sharp;
      sharp_part = by_ratio / o.det;
      const float by_det = -by_ratio * o.det_sharp / (o.det * o.det);
      gxx += by_det * o.yy, gyy += by_det * o.xx, gxy -= by_det * o.xy;
    }
    const float sxx = o.xx - blur, syy = o.yy - blur;
    gxx += sharp_part * syy, gyy += sharp_part * sxx, gxy -= sharp_part * o.xy;
    float gn[3][3], by_slope[2] = {0.0f, 0.0f}, by_over_z = 0.0f;
    for (int k = 0; k < 3; k++) {
      const float gp[2] = {2.0f * (gxx * o.p[0][k] + gxy * o.p[1][k]), 2.0f * (gxy * o.p[0][k] + gyy * o.p[1][k])};
      gn[2][k] = 0.0f;
      for (int j = 0; j < 2; j++) {
        gn[j][k] = gp[j] * f[j] / z;
        gn[2][k] -= gp[j] * f[j] / z * o.slope[j];
        by_slope[j] -= gp[j] * f[j] / z * o.n[2][k];
        by_over_z -= gp[j] * o.p[j][k] / z;  // p is proportional to 1 / z
      }
    }
    float gt[3] = {0.0f, 0.0f, g[6] + by_over_z};
    for (int j = 0; j < 2; j++) {
      const float by_exact = g[j] * f[j] + (o.held[j] ? 0.0f : by_slope[j]);  // by t_j / z
      gt[j] = by_exact / z;
      gt[2] -= by_exact * o.t[j] / (z * z);
    }
    float gr[3][3], gs[3] = {0.0f, 0.0f, 0.0f};
    for (int j = 0; j < 3; j++)
      for (int k = 0; k < 3; k++) {
        const float gm = o.w[0][j] * gn[0][k] + o.w[1][j] * gn[1][k] + o.w[2][j] * gn[2][k];
        gs[k] += gm * o.r[j][k] * o.s[k];
        gr[j][k] = gm * o.s[k];
      }
    for (int k = 0; k < 3; k++) {
      to[k] = o.w[0][k] * gt[0] + o.w[1][k] * gt[1] + o.w[2][k] * gt[2];
      to[3 + k] = gs[k];
    }
    turn_back(o, gr, to + 6);
    if (!with_pose) continue;
    for (int j = 0; j < 3; j++) {
      for (int k = 0; k < 3; k++) {
        float by_w = gt[j] * means[3 * (size_t)i + k];
        for (int l = 0; l < 3; l++) by_w += gn[j][l] * o.r[k][l] * o.s[l];
        to[11 + 4 * j + k] = by_w;
      }
      to[11 + 4 * j + 3] = gt[j];
    }
  }
}

// Harmonics 0 to 15 of a unit direction, with 3DGS's signs, and their derivatives by it.
#define C1 0.48860251190f
static inline void harmonics(float x, float y, float z, float h[16]) {
  const float xx = x * x, yy = y * y, zz = z * z;
  h[0] = 0.28209479177f;
  h[1] = -C1 * y, h[2] = C1 * z, h[3] = -C1 * x;
  h[4] = 1.0925484306f * x * y, h[5] = -1.0925484306f * y * z, h[6] = 0.31539156525f * (2.0f * zz - xx - yy);
  h[7] = -1.0925484306f * x * z, h[8] = 0.54627421529f * (xx - yy);
  h[9] = -0.59004358993f * y * (3.0f * xx - yy), h[10] = 2.8906114426f * x * y * z;
  h[11] = -0.45704579946f * y * (4.0f * zz - xx - yy), h[12] = 0.37317633259f * z * (2.0f * zz - 3.0f * xx - 3.0f * yy);
  h[13] = -0.45704579946f * x * (4.0f * zz - xx - yy), h[14] = 1.4453057213f * z * (xx - yy);
  h[15] = -0.59004358993f * x * (xx - 3.0f * yy);
}
// The sum of u_i d h_i / d (x, y, z).
static inline float3 slopes(float x, float y, float z, const float u[16]) {
  const float xx = x * x, yy = y * y, zz = z * z;
  float3 d;
  d.x = -C1 * u[3] + 1.0925484306f * (y * u[4] - z * u[7]) - 0.63078313050f * x * u[6] + 1.0925484306f * x * u[8];
  d.y = -C1 * u[1] + 1.0925484306f * (x * u[4] - z * u[5]) - 0.63078313050f * y * u[6] - 1.0925484306f * y * u[8];
  d.z = C1 * u[2] - 1.0925484306f * (y * u[5] + x * u[7]) + 1.2615662610f * z * u[6];
  d.x += -3.5402615396f * x * y * u[9] + 2.8906114426f * y * z * u[10] + 0.91409159893f * x * y * u[11] -
         2.2390579955f * x * z * u[12] - 0.45704579946f * (4.0f * zz - 3.0f * xx - yy) * u[13] + 2.8906114426f * x * z * u[14] -
         1.7701307698f * (xx - yy) * u[15];
  d.y += -1.7701307698f * (xx - yy) * u[9] + 2.8906114426f * x * z * u[10] - 0.45704579946f * (4.0f * zz - xx - 3.0f * yy) * u[11] -
         2.2390579955f * y * z * u[12] + 0.91409159893f * x * y * u[13] - 2.8906114426f * y * z * u[14] + 3.5402615396f * x * y * u[15];
  d.z += 2.8906114426f * x * y * u[10] - 3.6563663957f * y * z * u[11] + 1.1195289978f * (2.0f * zz - xx - yy) * u[12] -
         3.6563663957f * x * z * u[13] + 1.4453057213f * (xx - yy) * u[14];
  return d;
}

// first [G,3], rest [G,15,3], means [G,3], eyes [N,3] (owned: one an owner), of the first `bands` numbers of harmonics (1, 4,
// 9 or 16) -> out [G,3].
__kernel FAT void colours(__global const float* restrict first, __global const float* restrict rest,
                          __global const float* restrict means, __global const float* restrict eyes,
                          __global const int* restrict owners, int owned, __global float* restrict out, int count,
                          int bands, int chunk) {
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) {
    __global const float *m = means + 3 * (size_t)i, *more = rest + 45 * (size_t)i, *eye = eyes + 3 * (owned ? owners[i] : 0);
    const float dx = m[0] - eye[0], dy = m[1] - eye[1], dz = m[2] - eye[2];
    const float over = 1.0f / fmax(sqrt(dx * dx + dy * dy + dz * dz), 1e-12f);
    float h[16], sum[3];
    harmonics(dx * over, dy * over, dz * over, h);
    for (int c = 0; c < 3; c++) sum[c] = 0.5f + h[0] * first[3 * (size_t)i + c];
    for (int k = 1; k < bands; k++)
      for (int c = 0; c < 3; c++) sum[c] += h[k] * more[3 * (k - 1) + c];
    for (int c = 0; c < 3; c++) out[3 * (size_t)i + c] = fmax(sum[c], 0.0f);
  }
}

// A gaussian's colours where they were not cut off (found, of the kernel above, is above 0): what the gradient g [G,3] reaches.
static inline int reached(__global const float* found, __global const float* gradient, float g[3]) {
  for (int c = 0; c < 3; c++) g[c] = found[c] > 0.0f ? gradient[c] : 0.0f;
  return g[0] != 0.0f || g[1] != 0.0f || g[2] != 0.0f;
}

// out [G,6]: first 3, mean 3.
__kernel FAT void colours_grad(__global const float* restrict rest, __global const float* restrict means,
                               __global const float* restrict eyes, __global const int* restrict owners, int owned,
                               __global const float* restrict found,
                               __global const float* restrict gradient, __global float* restrict out, int count,
                               int bands, int chunk) {
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) {
    __global const float *m = means + 3 * (size_t)i, *more = rest + 45 * (size_t)i, *eye = eyes + 3 * (owned ? owners[i] : 0);
    __global float* to = out + 6 * (size_t)i;
    float g[3], u[16];
    if (!reached(found + 3 * (size_t)i, gradient + 3 * (size_t)i, g)) {
      for (int k = 0; k < 6; k++) to[k] = 0.0f;
      continue;
    }
    const float dx = m[0] - eye[0], dy = m[1] - eye[1], dz = m[2] - eye[2];
    const float over = 1.0f / fmax(sqrt(dx * dx + dy * dy + dz * dz), 1e-12f);
    const float x = dx * over, y = dy * over, z = dz * over;
    u[0] = 0.0f;
    for (int c = 0; c < 3; c++) to[c] = 0.28209479177f * g[c];
    for (int k = 1; k < 16; k++)
      u[k] = k < bands ? more[3 * (k - 1)] * g[0] + more[3 * (k - 1) + 1] * g[1] + more[3 * (k - 1) + 2] * g[2] : 0.0f;
    const float3 d = slopes(x, y, z, u);
    const float along = d.x * x + d.y * y + d.z * z;
    to[3] = (d.x - along * x) * over;
    to[4] = (d.y - along * y) * over;
    to[5] = (d.z - along * z) * over;
  }
}

// out [G,45]: of rest. Apart, so that it lies where the optimiser reads it.
__kernel FAT void colours_rest_grad(__global const float* restrict means, __global const float* restrict eyes,
                                    __global const int* restrict owners, int owned, __global const float* restrict found,
                                    __global const float* restrict gradient, __global float* restrict out, int count,
                                    int bands, int chunk) {
  for (int i = LOOP_LO(chunk); i < LOOP_HI(count, chunk); i += LOOP_STEP) {
    __global const float *m = means + 3 * (size_t)i, *eye = eyes + 3 * (owned ? owners[i] : 0);
    __global float* to = out + 45 * (size_t)i;
    float g[3], h[16];
    const int used = reached(found + 3 * (size_t)i, gradient + 3 * (size_t)i, g) ? bands : 1;
    if (used > 1) {
      const float dx = m[0] - eye[0], dy = m[1] - eye[1], dz = m[2] - eye[2];
      const float over = 1.0f / fmax(sqrt(dx * dx + dy * dy + dz * dz), 1e-12f);
      harmonics(dx * over, dy * over, dz * over, h);
      for (int k = 1; k < used; k++)
        for (int c = 0; c < 3; c++) to[3 * (k - 1) + c] = h[k] * g[c];
    }
    for (int k = 3 * (used - 1); k < 45; k++) to[k] = 0.0f;
  }
}
