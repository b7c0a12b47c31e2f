// Rays through a street: a background known by voxels, actors in boxes that move, the sky behind. (GenAssets, supplement
// A; UniSim, Yang et al. 2023.) A work-item a ray (a chunk of rays on CPU devices).
//
// Of each moment m the boxes [first_box[m], first_box[m + 1]).
// Grid, 16 numbers: corner (3), voxel size, counts (3), centre (3) and half sizes (3) of what is not contracted, far
// distance of the sky.

// A kernel that counts and the kernel that writes after it must decide alike, so nothing in this file is contracted: a
// compiler may turn a * b + c into a fused operation in one of them and not in the other.
#pragma OPENCL FP_CONTRACT OFF

#define HITS 48
#define BLOCK 8

typedef struct {  // ops/street.h: StreetBox
  float rotation[9], centre[3], half_size[3], cube_scale, owner;
} Box;

typedef struct {
  float step, actor_step;
  int sky, shadows;
} Steps;

typedef struct {
  float3 origin, direction;
  float background_shift, actor_shift;
} Ray;

// Where the results of a ray go; counting has no arrays.
typedef struct {
  int all, background, actor, shadow;
} Places;

typedef struct {
  __global float *t, *points, *actor_points, *shadow_points, *actor_directions, *shadow_directions, *shadow_t;
  __global int *rows, *owners, *shadow_owners, *ray_of, *shadow_rays;
  int background_count;
} Results;

static inline float3 turned(__global const Box* box, float3 v) {
  __global const float* b = box->rotation;
  return (float3)(b[0] * v.x + b[1] * v.y + b[2] * v.z, b[3] * v.x + b[4] * v.y + b[5] * v.z, b[6] * v.x + b[7] * v.y + b[8] * v.z);
}
static inline float3 to_box(__global const Box* b, float3 p) { return turned(b, p - vload3(0, b->centre)); }

// Where a ray is within |p| < half; x > y: nowhere.
static inline float2 inside(float3 p, float3 d, float3 half_size) {
  const float3 safe = (float3)(fabs(d.x) < 1e-9f ? 1e-9f : d.x, fabs(d.y) < 1e-9f ? 1e-9f : d.y, fabs(d.z) < 1e-9f ? 1e-9f : d.z);
  const float3 a = (-half_size - p) / safe, b = (half_size - p) / safe;
  const float3 lo = fmin(a, b), hi = fmax(a, b);
  return (float2)(fmax(fmax(lo.x, lo.y), fmax(lo.z, 0.0f)), fmin(hi.x, fmin(hi.y, hi.z)));
}

// mip-NeRF 360's contraction with the largest coordinate for a norm, to [0,1]^3.
static inline float3 contracted(float3 p, __global const float* grid) {
  const float3 x = (p - vload3(0, grid + 7)) / vload3(0, grid + 10);
  const float norm = fmax(fabs(x.x), fmax(fabs(x.y), fabs(x.z)));
  return (norm > 1.0f ? x * ((2.0f - 1.0f / norm) / norm) : x) * 0.25f + 0.5f;
}

// A box's own coordinates in [0,1]^3.
static inline float3 in_cube(__global const Box* b, float3 p, float shrink) { return p * (b->cube_scale * shrink) + 0.5f; }

INLINE void add_actor(const Ray* ray, __global const Box* b, float from, float to, float step, int write, Places* at, const Results* out) {
  const float3 p = to_box(b, ray->origin), d = turned(b, ray->direction);
  // In whole steps from where the ray enters the box, whatever lies before it.
  const float enters = inside(p, d, vload3(0, b->half_size)).x;
  int k = max(0, (int)ceil((from - enters) / step - ray->actor_shift));
  for (float t = enters + ((float)k + ray->actor_shift) * step; t < to; k++, t = enters + ((float)k + ray->actor_shift) * step) {
    if (write) {
      out->t[at->all] = t;
      out->rows[at->all] = out->background_count + at->actor;
      vstore3(in_cube(b, p + t * d, 1.0f), at->actor, out->actor_points);
      vstore3(d, at->actor, out->actor_directions);
      out->owners[at->actor] = (int)b->owner;
    }
    at->all++;
    at->actor++;
  }
}

INLINE void add_background(const Ray* ray, __global const float* grid, int r, float t, float seen_t, int write, Places* at, const Results* out) {
  if (write) {
    out->t[at->all] = seen_t;
    out->rows[at->all] = at->background;
    vstore3(contracted(ray->origin + t * ray->direction, grid), at->background, out->points);
    out->ray_of[at->background] = r;
  }
  at->all++;
  at->background++;
}

// The ground's part under a box, twice as large as it: where its shadow may fall.
INLINE void add_shadow(const Ray* ray, __global const Box* b, int r, int write, Places* at, const Results* out) {
  const float3 p = to_box(b, ray->origin), d = turned(b, ray->direction);
  const float t = (-b->half_size[2] - p.z) / d.z;
  const float3 hit = p + t * d;
  if (!(d.z < -1e-4f && t > 0.0f && fabs(hit.x) < 2.0f * b->half_size[0] && fabs(hit.y) < 2.0f * b->half_size[1])) return;
  if (write) {
    vstore3(in_cube(b, hit, 0.5f), at->shadow, out->shadow_points);
    vstore3(d, at->shadow, out->shadow_directions);
    out->shadow_owners[at->shadow] = (int)b->owner;
    out->shadow_t[at->shadow] = t;
    out->shadow_rays[at->shadow] = r;
  }
  at->shadow++;
}

// Boxes that a ray meets, HITS at a time, by the distance at which it enters them; ties go by number. Where boxes overlap,
// later ones begin where earlier ones end.
typedef struct {
  float2 spans[HITS];  // first and last distance
  int which[HITS];
  int next, count, more;  // more: there are boxes behind these
  float entered, end;     // the last of these was entered there; all end there
  int last;               // its number
  float begin;            // of box number `next`; INFINITY: there is none
} Hits;

// The boxes behind those that were found before.
INLINE void find_hits(const Ray* ray, __global const Box* boxes, int first, int last, Hits* hits) {
  const float entered = hits->entered;
  const int before = hits->last;
  int count = 0, more = 0;
  for (int b = first; b < last; b++) {
    __global const Box* box = boxes + b;
    const float2 span = inside(to_box(box, ray->origin), turned(box, ray->direction), vload3(0, box->half_size));
    if (span.x >= span.y) continue;
    if (span.x < entered || (span.x == entered && b <= before)) continue;
    more |= count == HITS;
    if (count == HITS && hits->spans[HITS - 1].x <= span.x) continue;
    int place = count < HITS ? count++ : HITS - 1;
    for (; place > 0 && hits->spans[place - 1].x > span.x; place--) {
      hits->spans[place] = hits->spans[place - 1];
      hits->which[place] = hits->which[place - 1];
    }
    hits->spans[place] = span;
    hits->which[place] = b;
  }
  hits->next = 0;
  hits->count = count;
  hits->more = more;
  if (count > 0) {
    hits->entered = hits->spans[count - 1].x;
    hits->last = hits->which[count - 1];
  }
  for (int i = 0; i < count; i++) {
    hits->spans[i].x = fmax(hits->spans[i].x, hits->end);
    hits->end = hits->spans[i].y = fmax(hits->spans[i].x, hits->spans[i].y);
  }
}

// On to the next box: number `next`, or the first of those behind.
INLINE void pass(const Ray* ray, __global const Box* boxes, int first, int last, int next, Hits* hits) {
  hits->next = next;
  if (next == hits->count && hits->more) find_hits(ray, boxes, first, last, hits);
  hits->begin = hits->next < hits->count ? hits->spans[hits->next].x : INFINITY;
}

// All samples of a ray in the order of distance: counted, or written as well.
INLINE void walk(const Ray* ray, int r, __global const Box* boxes, int first, int last, __global const float* grid,
                 __global const uchar* cells, __global const uchar* blocks, const Steps* s, int write, Places* at, const Results* out) {
  Hits hits;
  hits.count = 0;
  hits.more = first < last;
  hits.entered = -1.0f;
  hits.end = 0.0f;
  hits.last = -1;
  pass(ray, boxes, first, last, 0, &hits);
  const float voxel = grid[3];
  const int3 counts = (int3)((int)grid[4], (int)grid[5], (int)grid[6]);
  const int3 block_counts = (counts + BLOCK - 1) / BLOCK;
  const float3 size = (float3)((float)counts.x, (float)counts.y, (float)counts.z) * voxel;
  const float3 start = ray->origin - vload3(0, grid), d = ray->direction;
  const float2 range = inside(start - 0.5f * size, d, 0.5f * size);
  float t_free = 0.0f;  // the background begins again behind the boxes met so far
  if (range.x < range.y) {
    int k = max(0, (int)ceil(range.x / s->step - ray->background_shift));
    for (float t = ((float)k + ray->background_shift) * s->step; t < range.y; t = ((float)k + ray->background_shift) * s->step) {
      for (; hits.begin <= t; pass(ray, boxes, first, last, hits.next + 1, &hits)) {
        const float2 span = hits.spans[hits.next];
        add_actor(ray, boxes + hits.which[hits.next], span.x, span.y, s->actor_step, write, at, out);
        t_free = span.y;
      }
      const float3 p = (start + t * d) / voxel;
      const int3 c = clamp((int3)((int)p.x, (int)p.y, (int)p.z), (int3)(0), counts - 1), b = c / BLOCK;
      if (blocks[(b.z * block_counts.y + b.y) * block_counts.x + b.x] == 0) {
        // Nothing in this block: on to its end.
        const float3 half_block = (float3)(0.5f * BLOCK);
        const float3 middle = (float3)((float)b.x, (float)b.y, (float)b.z) * (float)BLOCK + half_block;
        const float end = t + inside(p - middle, d / voxel, half_block).y;
        k = max(k + 1, (int)ceil(end / s->step - ray->background_shift));
        continue;
      }
      if (t >= t_free && cells[(c.z * counts.y + c.y) * counts.x + c.x]) add_background(ray, grid, r, t, t, write, at, out);
      k++;
    }
  }
  for (; hits.begin < INFINITY; pass(ray, boxes, first, last, hits.next + 1, &hits)) {
    const float2 span = hits.spans[hits.next];
    add_actor(ray, boxes + hits.which[hits.next], span.x, span.y, s->actor_step, write, at, out);
  }
  // The sky's samples in even steps of 1 / distance from the edge of the grid on; they are seen at that edge,
  // and marked by a sign.
  const float edge = fmax(range.x < range.y ? range.y : 1.0f, hits.end);
  for (int i = 0; i < s->sky; i++) {
    const float share = ((float)i + ray->background_shift) / (float)s->sky;
    add_background(ray, grid, r, 1.0f / ((1.0f - share) / edge + share / fmax(grid[13], 2.0f * edge)), -edge, write, at, out);
  }
  if (s->shadows)
    for (int b = first; b < last; b++) add_shadow(ray, boxes + b, r, write, at, out);
}

INLINE Ray ray_at(int r, __global const float* origins, __global const float* directions, __global const float* jitter) {
  const Ray ray = {vload3(r, origins), vload3(r, directions), jitter[2 * r], jitter[2 * r + 1]};
  return ray;
}

// counts [4][rays + 1]: all samples, those of the background, of actors, places of shadows; the last of each is 0.
FAT __kernel void street_count(__global const float* restrict origins, __global const float* restrict directions, __global const float* restrict jitter,
                               __global const int* restrict moments, __global const int* restrict first_box, __global const Box* restrict boxes,
                               __global const float* restrict grid, __global const uchar* restrict cells, __global const uchar* restrict blocks,
                               __global int* restrict counts, int rays, float step, float actor_step, int sky, int shadows, int chunk) {
  const Steps s = {step, actor_step, sky, shadows};
  const Results none = {0};
  const int end = min(rays + 1, ((int)get_global_id(0) + 1) * chunk);
  for (int r = get_global_id(0) * chunk; r < end; r++) {
    Places at = {0, 0, 0, 0};
    if (r < rays) {
      const Ray ray = ray_at(r, origins, directions, jitter);
      walk(&ray, r, boxes, first_box[moments[r]], first_box[moments[r] + 1], grid, cells, blocks, &s, 0, &at, &none);
    }
    counts[r] = at.all;
    counts[rays + 1 + r] = at.background;
    counts[2 * (rays + 1) + r] = at.actor;
    counts[3 * (rays + 1) + r] = at.shadow;
  }
}

// starts: the running sums of counts, one row each.
FAT __kernel void street_write(__global const float* restrict origins, __global const float* restrict directions, __global const float* restrict jitter,
                               __global const int* restrict moments, __global const int* restrict first_box, __global const Box* restrict boxes,
                               __global const float* restrict grid, __global const uchar* restrict cells, __global const uchar* restrict blocks,
                               __global const int* restrict starts, __global float* restrict t, __global int* restrict rows,
                               __global float* restrict points, __global int* restrict ray_of, __global float* restrict actor_points,
                               __global float* restrict actor_directions, __global int* restrict owners, __global float* restrict shadow_points,
                               __global float* restrict shadow_directions, __global int* restrict shadow_owners, __global float* restrict shadow_t,
                               __global int* restrict shadow_rays, int rays, float step, float actor_step, int sky, int shadows, int chunk) {
  const Steps s = {step, actor_step, sky, shadows};
  const Results out = {t, points, actor_points, shadow_points, actor_directions, shadow_directions, shadow_t, rows, owners, shadow_owners,
                       ray_of, shadow_rays, starts[2 * rays + 1]};
  const int end = min(rays, ((int)get_global_id(0) + 1) * chunk);
  for (int r = get_global_id(0) * chunk; r < end; r++) {
    Places at = {starts[r], starts[rays + 1 + r], starts[2 * (rays + 1) + r], starts[3 * (rays + 1) + r]};
    const Ray ray = ray_at(r, origins, directions, jitter);
    walk(&ray, r, boxes, first_box[moments[r]], first_box[moments[r] + 1], grid, cells, blocks, &s, 1, &at, &out);
  }
}

// For each ray the owner of the actor that most light comes from (-1: none has half of it).
FAT __kernel void blend_owners(__global const float* restrict alpha, __global const int* restrict rows, __global const int* restrict offsets,
                               __global const int* restrict owners, __global int* restrict seen, int rays, int background, int chunk) {
  const int end = min(rays, ((int)get_global_id(0) + 1) * chunk);
  for (int r = get_global_id(0) * chunk; r < end; r++) {
    float through = 1.0f, best = 0.5f, sum = 0.0f;
    int current = -1;
    seen[r] = -1;
    for (int i = offsets[r]; i < offsets[r + 1]; i++) {
      const int row = rows[i], owner = row < background ? -1 : owners[row - background];
      if (owner != current) sum = 0.0f, current = owner;
      sum += through * alpha[row];
      through *= 1.0f - alpha[row];
      if (owner >= 0 && sum > best) best = sum, seen[r] = owner;
    }
  }
}

// What of each ray's samples is worth shading: those that light reaches (transmittance `least` and more), and the last,
// which takes the light that is left. counts [3][rays + 1] as street_count's first three.
FAT __kernel void lit_count(__global const float* restrict alpha, __global const int* restrict rows, __global const int* restrict offsets,
                            __global int* restrict counts, int rays, int background, float least, int chunk) {
  const int end = min(rays + 1, ((int)get_global_id(0) + 1) * chunk);
  for (int r = get_global_id(0) * chunk; r < end; r++) {
    int all = 0, behind = 0;
    if (r < rays) {
      float through = 1.0f;
      const int last = offsets[r + 1] - 1;
      for (int i = offsets[r]; i <= last; i++) {
        const int row = rows[i];
        if (through >= least || i == last) {
          all++;
          behind += row < background;
        }
        through *= 1.0f - alpha[row];
      }
    }
    counts[r] = all;
    counts[rays + 1 + r] = behind;
    counts[2 * (rays + 1) + r] = all - behind;
  }
}

FAT __kernel void lit_write(__global const float* restrict alpha, __global const int* restrict rows, __global const int* restrict offsets,
                            __global const float* restrict t, __global const float* restrict points, __global const float* restrict actor_points,
                            __global const float* restrict actor_directions, __global const int* restrict owners, __global const int* restrict starts,
                            __global int* restrict to_rows, __global float* restrict to_t, __global float* restrict to_points,
                            __global int* restrict to_ray, __global float* restrict to_actor_points, __global float* restrict to_actor_directions,
                            __global int* restrict to_owners, int rays, int background, float least, int chunk) {
  const int end = min(rays, ((int)get_global_id(0) + 1) * chunk), kept_background = starts[2 * rays + 1];
  for (int r = get_global_id(0) * chunk; r < end; r++) {
    int at = starts[r], b = starts[rays + 1 + r], a = starts[2 * (rays + 1) + r];
    float through = 1.0f;
    const int last = offsets[r + 1] - 1;
    for (int i = offsets[r]; i <= last; i++) {
      const int row = rows[i];
      if (through >= least || i == last) {
        to_t[at] = t[i];
        if (row < background) {
          to_rows[at] = b;
          vstore3(vload3(row, points), b, to_points);
          to_ray[b++] = r;
        } else {
          to_rows[at] = kept_background + a;
          vstore3(vload3(row - background, actor_points), a, to_actor_points);
          vstore3(vload3(row - background, actor_directions), a, to_actor_directions);
          to_owners[a++] = owners[row - background];
        }
        at++;
      }
      through *= 1.0f - alpha[row];
    }
  }
}
