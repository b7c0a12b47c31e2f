#include "runtime/float64.h"

#include <doctest/doctest.h>

using namespace cloam;

TEST_CASE(
    "in float64 a kernel's types, literals, conversions and infinities are of 64 bits, and nothing else changes") {
  const std::string pragma = "#pragma OPENCL EXTENSION cl_khr_fp64 : enable\n";
  const auto same = [&](const std::string& from, const std::string& to) { CHECK(in_float64(from) == pragma + to); };
  same("__global const float* x, float4 v", "__global const double* x, double4 v");
  same("1.0f + .5f - 1e-5f * 2.5e+3f / 0x1p-24f", "1.0 + .5 - 1e-5 * 2.5e+3 / 0x1p-24");
  same("0xff + 0x7fffffffu - 15 + a-1.0f", "0xff + 0x7fffffffu - 15 + a-1.0");
  same("convert_float16(i) + convert_int4(f)", "convert_double16(i) + convert_int4(f)");
  same("-INFINITY, NAN", "-HUGE_VAL, nan(0ul)");
  same("floats, as_float(b), float_of, v.x0f, half2", "floats, as_float(b), float_of, v.x0f, half2");
}
