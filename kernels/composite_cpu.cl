// Compositing along rays (kernels/composite.cl says what is computed) on CPU devices, of densities and three channels that
// lie in order: 16 samples of a ray at a time. What lies in front of a sample comes by running products and sums within
// the vector.
//: variant composite_samples cpu samples

INLINE float16 running_product(float16 v) {
  const float16 none = (float16)(1.0f);
  v *= BELOW1(v, none);
  v *= BELOW2(v, none);
  v *= BELOW4(v, none);
  return v * BELOW8(v, none);
}
INLINE float16 running_sum(float16 v) {
  const float16 none = (float16)(0.0f);
  v += BELOW1(v, none);
  v += BELOW2(v, none);
  v += BELOW4(v, none);
  return v + BELOW8(v, none);
}

// Three vectors of x y z x y z ...: of each number three times, and apart.
typedef struct {
  float16 a, b, c;
} Triple;
INLINE Triple thrice(float16 v) {
  const Triple t = {v.s0001112223334445, v.s55666777888999aa, v.sabbbcccdddeeefff};
  return t;
}
INLINE float16 join3(float16 first, float16 second, int from, float16 third, int to) {
  return select(select(first, second, LANE_NUMBERS >= from), third, LANE_NUMBERS >= to);
}
INLINE Triple apart(Triple v) {
  const Triple t = {join3(v.a.s0369cf0000000000, v.b.s000000258be00000, 6, v.c.s00000000000147ad, 11),
                    join3(v.a.s147ad00000000000, v.b.s000000369cf00000, 5, v.c.s00000000000258be, 11),
                    join3(v.a.s258be00000000000, v.b.s00000147ad000000, 5, v.c.s00000000000369cf, 10)};
  return t;
}
INLINE Triple read_triples(__global const float* from, int mine, int there) {
  const Triple t = {read_first(from, mine, there), read_first(from + 16, mine - 16, there - 16),
                    read_first(from + 32, mine - 32, there - 32)};
  return t;
}

// Samples i to i + 15 of a ray, of which `mine` are its own: weights, transmittance before and behind them, places.
typedef struct {
  float16 w, before, behind, t, s, dt, ds;
} Samples;
INLINE Samples read_samples(__global const float* sigma, __global const float* dt, int i, int mine, int there,
                            float through) {
  Samples x;
  x.dt = read_first(dt + i, mine, there);
  const float16 left = m_exp16(-(read_first(sigma + i, mine, there) * x.dt)), product = running_product(left);
  x.before = through * ONE_BEFORE(product, (float16)(1.0f));
  x.behind = through * product;
  x.w = x.before * (1.0f - left);
  return x;
}
// Squashed place and length, by one division: s = t / (1 + t), ds = dt / ((1 + t)^2 - dt^2 / 4).
INLINE Samples squash(Samples x, float16 t) {
  const float16 u = 1.0f + t, v = u * u - 0.25f * x.dt * x.dt, both = 1.0f / (u * v);
  x.t = t;
  x.s = t * v * both;
  x.ds = x.dt * u * both;
  return x;
}

typedef struct {
  float through;
  float16 depth, places, spread;
  Triple colour;
} Sums;

// The distortion, with what lies in front 1 - before and behind it behind - end: twice the sum of
// w s (1 - before - behind + end) + w^2 ds / 6.
INLINE void add_samples(Sums* sums, __global const float* sigma, __global const float* rgb, __global const float* t,
                        __global const float* dt, int i, int mine, int there) {
  const Samples x = squash(read_samples(sigma, dt, i, mine, there, sums->through), read_first(t + i, mine, there));
  const Triple seen = read_triples(rgb + 3 * (size_t)i, 3 * mine, 3 * there), w = thrice(x.w);
  const float16 place = x.w * x.s;
  sums->colour.a += w.a * seen.a;
  sums->colour.b += w.b * seen.b;
  sums->colour.c += w.c * seen.c;
  sums->depth += x.w * x.t;
  sums->places += place;
  sums->spread += place * (1.0f - x.before - x.behind) + x.w * x.w * x.ds * (1.0f / 6.0f);
  sums->through = x.behind.sf;
}

FAT __kernel void composite_samples(__global const float* restrict sigma, __global const float* restrict rgb,
                            __global const float* restrict t, __global const float* restrict dt,
                            __global const int* restrict offsets, __global float* restrict out, int rays, int chunk) {
  const int end_ray = min(rays, ((int)get_global_id(0) + 1) * chunk), all = offsets[rays];
  for (int r = get_global_id(0) * chunk; r < end_ray; r++) {
    const float16 none = (float16)(0.0f);
    Sums sums = {1.0f, none, none, none, {none, none, none}};
    int i = offsets[r];
    const int end = offsets[r + 1];
    for (; i + 16 <= end; i += 16) add_samples(&sums, sigma, rgb, t, dt, i, 16, 16);
    if (i < end) add_samples(&sums, sigma, rgb, t, dt, i, end - i, all - i);
    const Triple colour = apart(sums.colour);
    __global float* to = out + 7 * (size_t)r;
    to[0] = sum16(colour.a);
    to[1] = sum16(colour.b);
    to[2] = sum16(colour.c);
    to[3] = 1.0f - sums.through;
    to[4] = sum16(sums.depth);
    to[6] = sum16(sums.places);
    to[5] = 2.0f * (sum16(sums.spread) + sums.through * to[6]);
  }
}

FAT __kernel void composite_samples_weights(__global const float* restrict sigma, __global const float* restrict dt,
                                    __global const int* restrict offsets, __global float* restrict weights, int rays,
                                    int chunk) {
  const int end_ray = min(rays, ((int)get_global_id(0) + 1) * chunk), all = offsets[rays];
  for (int r = get_global_id(0) * chunk; r < end_ray; r++) {
    const int end = offsets[r + 1];
    float through = 1.0f;
    for (int i = offsets[r]; i < end; i += 16) {
      const Samples x = read_samples(sigma, dt, i, end - i, all - i, through);
      write_first(x.w, weights + i, end - i);
      through = x.behind.sf;
    }
  }
}

// What is known of a ray: its gradients, the sums over it, and what of them lies before the next samples.
typedef struct {
  float3 colour;
  float opacity, depth, distortion, end, all_places;
  float through, places, rest;
} Ray;

INLINE void samples_grad(Ray* ray, __global const float* sigma, __global const float* rgb, __global const float* t,
                         __global const float* dt, __global float* dsigma, __global float* drgb, int i, int mine,
                         int there) {
  const float3 c = ray->colour;
  const Samples x = squash(read_samples(sigma, dt, i, mine, there, ray->through), read_first(t + i, mine, there));
  const Triple seen = apart(read_triples(rgb + 3 * (size_t)i, 3 * mine, 3 * there)), w = thrice(x.w);
  const float16 place = x.w * x.s, up_to = ray->places + running_sum(place);
  const float16 spread = 2.0f * (x.s * (1.0f + ray->end - x.before - x.behind) - (2.0f * up_to - place - ray->all_places)) +
                         x.w * x.ds * (2.0f / 3.0f);
  const float16 u = c.x * seen.a + c.y * seen.b + c.z * seen.c + ray->opacity + ray->depth * x.t + ray->distortion * spread;
  const float16 rest = ray->rest - running_sum(x.w * u);
  write_first(x.dt * (x.behind * u - rest), dsigma + i, mine);
  __global float* to = drgb + 3 * (size_t)i;
  write_first(w.a * (float16)(c, c, c, c, c, c.x), to, 3 * mine);
  if (3 * mine > 16) write_first(w.b * (float16)(c.yz, c, c, c, c, c.xy), to + 16, 3 * mine - 16);
  if (3 * mine > 32) write_first(w.c * (float16)(c.z, c, c, c, c, c), to + 32, 3 * mine - 32);
  ray->through = x.behind.sf;
  ray->places = up_to.sf;
  ray->rest = rest.sf;
}

FAT __kernel void composite_samples_grad(__global const float* restrict sigma, __global const float* restrict rgb,
                                 __global const float* restrict t, __global const float* restrict dt,
                                 __global const int* restrict offsets, __global const float* restrict out,
                                 __global const float* restrict g, __global float* restrict dsigma,
                                 int rays, int samples, int chunk) {
  __global float* drgb = dsigma + samples;
  const int end_ray = min(rays, ((int)get_global_id(0) + 1) * chunk), all = offsets[rays];
  for (int r = get_global_id(0) * chunk; r < end_ray; r++) {
    __global const float *gr = g + 7 * (size_t)r, *sums = out + 7 * (size_t)r;
    const float rest = gr[0] * sums[0] + gr[1] * sums[1] + gr[2] * sums[2] + gr[3] * sums[3] + gr[4] * sums[4] +
                       2.0f * gr[5] * sums[5];
    Ray ray = {vload3(0, gr), gr[3], gr[4], gr[5], 1.0f - sums[3], sums[6], 1.0f, 0.0f, rest};
    int i = offsets[r];
    const int end = offsets[r + 1];
    for (; i + 16 <= end; i += 16) samples_grad(&ray, sigma, rgb, t, dt, dsigma, drgb, i, 16, 16);
    if (i < end) samples_grad(&ray, sigma, rgb, t, dt, dsigma, drgb, i, end - i, all - i);
  }
}
