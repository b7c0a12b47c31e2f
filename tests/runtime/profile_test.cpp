// A profile counts what ran and waits for nothing.
#include "runtime/profile.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstdio>

#include "runtime/device.h"
#include "runtime/ops.h"
#include "tests/runtime/child.h"

using namespace cloam;

TEST_CASE("child: a profile of six steps" * doctest::skip()) {
  const Tensor x = random_normal({100, 100}, {1});
  eval({x});
  start_profile(true);
  for (int i = 0; i < 6; i++) {
    const int64_t waits = device_stats().waits;
    eval({matmul(x, x) + 1.f});
    CHECK(device_stats().waits == waits);
    (void)sum(x).item();
    profile_step();
  }
  const Profile found = profile();
  int64_t calls = 0;
  double flops = 0;
  for (const KernelCost& cost : found.kernels) {
    calls += cost.calls;
    CHECK(cost.ms > 0);
    CHECK(cost.bytes > 0);
    flops += cost.flops;
  }
  CHECK(std::is_sorted(found.kernels.begin(), found.kernels.end(),
                       [](const auto& a, const auto& b) { return a.ms > b.ms; }));
  CHECK(flops >= 6 * 2e6);
  CHECK(found.step.steps == 3);
  CHECK(found.step.waits == 1);
  CHECK(found.step.allocated_bytes == 0);
  CHECK(found.step.launches * 6 == static_cast<double>(calls));
  CHECK(found.step.device_ms > 0);
  CHECK(found.step.device_ms < found.step.ms * device().compute_units);
  const std::string events = trace();
  CHECK(std::count(events.begin(), events.end(), '\n') >= calls);
  CHECK(events.find("\"tid\":2,\"name\":\"") != std::string::npos);
  CHECK(events.find("\"tid\":1,\"name\":\"eval\"") != std::string::npos);
  std::printf("profile done\n");
}

TEST_CASE("a profile counts launches, waits and bytes of each step") {
  const std::string out = output_of_child("", "child: a profile of six steps");
  CHECK_MESSAGE(out.find("profile done") != std::string::npos, out);
  CHECK_MESSAGE(out.find("ERROR") == std::string::npos, out);
}
