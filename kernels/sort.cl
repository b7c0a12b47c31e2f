// Stable radix sort by digits of BITS bits, least significant first (Knuth, The Art of Computer Programming 3, 5.2.5).
// A pass: each chunk of keys counts its digits into counts[digit][chunk], a running sum over them all gives every chunk
// the first place of each of its digits, `place` moves payload and keys there in order.
// WIDE: keys of two words, the low one first. NUMBERED: the payload is 0, 1, 2 ... and not read.
//: variant place reference any BITS=8 LENGTH=4096 CHUNKS=4096
//: variant place gpu any BITS=8 LENGTH=256 CHUNKS=65536
//: variant place_lines cpu any BITS=8 LENGTH=4096 CHUNKS=64
#define BINS (1 << BITS)
#if WIDE
typedef ulong sort_key;
#else
typedef uint sort_key;
#endif

// Bits whose unsigned order is the order of the keys. KIND: 0 unsigned, 1 signed, 2 float (all NaN last, -0 before 0).
inline sort_key ordered(sort_key key) {
#if KIND == 1
  return key ^ 0x80000000u;
#elif KIND == 2
  return (key & 0x7fffffffu) > 0x7f800000u ? 0xffffffffu : key ^ (key >> 31 ? 0xffffffffu : 0x80000000u);
#else
  return key;
#endif
}

inline int digit_of(sort_key key, int shift) { return (int)(key >> shift) & (BINS - 1); }

// keys [n]: words from keys_at on.
__kernel FAT void count_digits(__global const uint* restrict key_words, __global int* restrict counts, int keys_at,
                               int n, int chunks, int length, int shift) {
  __global const sort_key* keys = (__global const sort_key*)(key_words + keys_at);
  const int chunk = get_global_id(0);
  if (chunk >= chunks) return;
  int mine[BINS];
  for (int digit = 0; digit < BINS; digit++) mine[digit] = 0;
  const int end = min(n, (chunk + 1) * length);
  for (int i = chunk * length; i < end; i++) mine[digit_of(ordered(keys[i]), shift)]++;
  for (int digit = 0; digit < BINS; digit++) counts[digit * chunks + chunk] = mine[digit];
}

// out: the payload, then from out_at on the keys, with the bits `flip` turned over (the last pass gives signed keys back).
// Version 1: each to its place at once.
__kernel FAT void place(__global const uint* restrict key_words, __global const uint* restrict payload,
                        __global const int* restrict bases, __global uint* restrict out, int keys_at, int out_at, int n,
                        int chunks, int length, int shift, uint flip) {
  __global const sort_key* keys = (__global const sort_key*)(key_words + keys_at);
  __global sort_key* keys_out = (__global sort_key*)(out + out_at);
  const int chunk = get_global_id(0);
  if (chunk >= chunks) return;
  int next[BINS];
  for (int digit = 0; digit < BINS; digit++) next[digit] = bases[digit * chunks + chunk];
  const int end = min(n, (chunk + 1) * length);
  for (int i = chunk * length; i < end; i++) {
    const sort_key key = ordered(keys[i]);
    const int to = next[digit_of(key, shift)]++;
    keys_out[to] = key ^ flip;
    out[to] = NUMBERED ? (uint)i : payload[i];
  }
}

// The same by way of lines: what goes to one digit's places is gathered in the core's cache and leaves as whole cache
// lines past the caches, which a key at a time would fetch first ("software write combining": Wassenberg and Sanders,
// Engineering a Multi-core Radix Sort, 2011). Up to 48 KiB of local memory, which GPUs may not have.
#if CLOAM_CPU
#define LINE 16

// Sends the places [begin, end) of one line; begin > its start where the chunk's places begin within the line.
inline void send_line(__local const sort_key* keys, __local const uint* payload, __global sort_key* keys_out,
                      __global uint* out, int begin, int end) {
  if (end - begin == LINE) {
    for (int part = 0; part < LINE; part += 64 / sizeof(sort_key))
      STORE_PAST_CACHES(*(__local const uint16*)(keys + part), (__global uint16*)(keys_out + begin + part));
    STORE_PAST_CACHES(*(__local const uint16*)payload, (__global uint16*)(out + begin));
  } else {
    for (int i = begin; i < end; i++) {
      keys_out[i] = keys[i & (LINE - 1)];
      out[i] = payload[i & (LINE - 1)];
    }
  }
}

__kernel FAT void place_lines(__global const uint* restrict key_words, __global const uint* restrict payload,
                              __global const int* restrict bases, __global uint* restrict out, int keys_at, int out_at,
                              int n, int chunks, int length, int shift, uint flip) {
  __global const sort_key* keys = (__global const sort_key*)(key_words + keys_at);
  __global sort_key* keys_out = (__global sort_key*)(out + out_at);
  __local sort_key line_keys[BINS * LINE] __attribute__((aligned(64)));
  __local uint line_payload[BINS * LINE] __attribute__((aligned(64)));
  const int chunk = get_global_id(0);
  int first[BINS], next[BINS];
  for (int digit = 0; digit < BINS; digit++) first[digit] = next[digit] = bases[digit * chunks + chunk];
  const int end = min(n, (chunk + 1) * length);
  for (int i = chunk * length; i < end; i++) {
    const sort_key key = ordered(keys[i]);
    const int digit = digit_of(key, shift), to = next[digit]++, line = digit * LINE, slot = to & (LINE - 1);
    line_keys[line + slot] = key ^ flip;
    line_payload[line + slot] = NUMBERED ? (uint)i : payload[i];
    if (slot == LINE - 1)
      send_line(line_keys + line, line_payload + line, keys_out, out, max(first[digit], to + 1 - LINE),
                to + 1);
  }
  for (int digit = 0; digit < BINS; digit++) {
    const int to = next[digit], line = digit * LINE;
    send_line(line_keys + line, line_payload + line, keys_out, out, max(first[digit], to & ~(LINE - 1)),
              to);
  }
}
#endif
