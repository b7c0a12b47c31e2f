// A step in shares: the gradients, and all else that it leaves behind, are those of the whole batch.
#include "models/train/shared_step.h"

#include <doctest/doctest.h>

#include <barrier>
#include <chrono>
#include <cmath>
#include <cstring>
#include <thread>

#include "models/train/pretended_ranks.h"
#include "models/train/shared_memory.h"
#include "tests/models/resume.h"
#include "tests/models/worlds.h"

using namespace cloam;

namespace {

const Worlds& worlds() {
  static const Worlds all;
  return all;
}

std::unique_ptr<Method> small_method(const std::string& name, const Settings& more = {}) {
  Settings settings = small_settings(name);
  settings.insert(settings.end(), more.begin(), more.end());
  if (name == "genassets") settings.emplace_back("batch.patches", "3");
  auto method = configured(name, settings);
  load_world(*method, worlds());
  return method;
}

std::vector<float> numbers_in(const NamedTensor& tensor) {
  std::vector<float> out(tensor.data.size() / sizeof(float));
  std::memcpy(out.data(), tensor.data.data(), tensor.data.size());
  return out;
}

using Values = std::map<std::string, std::vector<float>>;

/// Adam's first moments after one step are a tenth of its gradients.
Values moments_after(Method& method, int64_t shares) {
  Optimiser optimiser(method.parameters(), method.groups());
  SharedSteps({alone(), shares}).take(method, optimiser, {1, 10, 1});
  Values out;
  for (const auto& [name, tensor] : optimiser.state())
    if (name.starts_with("m.")) out[name.substr(2)] = numbers_in(tensor);
  return out;
}

double norm(const std::vector<float>& values) {
  double sum = 0;
  for (const float value : values) sum += static_cast<double>(value) * static_cast<double>(value);
  return std::sqrt(sum);
}

/// Of the difference, over the norm of what was expected.
double error_of(const std::vector<float>& found, const std::vector<float>& expected) {
  std::vector<float> difference;
  for (size_t i = 0; i < found.size(); ++i) difference.push_back(found[i] - expected[i]);
  return norm(difference) / std::max(norm(expected), 1e-12);
}

/// The mean over `shares` of the gradients that the method gives for each, asked for alone.
Values mean_of_shares(const std::string& name, int64_t shares) {
  Values sums;
  for (int64_t rank = 0; rank < shares; ++rank) {
    const auto method = small_method(name);
    Tensors wanted;
    std::vector<std::string> names;
    for (const auto& [parameter, tensor] : method->parameters()) {
      if (group_of(parameter, method->groups()).frozen) continue;
      names.push_back(parameter);
      wanted.push_back(tensor);
    }
    const Step step = method->step({1, 10, 1, {rank, shares}}, wanted);
    for (size_t i = 0; i < names.size(); ++i) {
      std::vector<float>& sum = sums[names[i]];
      sum.resize(static_cast<size_t>(wanted[i].numel()));
      if (!step.gradients[i]) continue;
      const std::vector<float> one = step.gradients[i].to_host();
      for (size_t k = 0; k < one.size(); ++k) sum[k] += one[k] / static_cast<float>(shares);
    }
  }
  return sums;
}

}  // namespace

TEST_CASE("batches that are drawn as a whole: the gradients of three shares are those of one") {
  for (const std::string name : {"nerf", "zipnerf", "diffusion"}) {
    CAPTURE(name);
    const Values whole = moments_after(*small_method(name), 1), parts = moments_after(*small_method(name), 3);
    for (const auto& [parameter, expected] : whole) {
      CAPTURE(parameter);
      CHECK(error_of(parts.at(parameter), expected) < 1e-5);
    }
  }
}

TEST_CASE("gradients of three shares are the mean of those that each has alone") {
  for (const std::string name : {"splat", "street-gaussians", "genassets", "neurad"}) {
    CAPTURE(name);
    const Values parts = moments_after(*small_method(name), 3), expected = mean_of_shares(name, 3);
    for (const auto& [parameter, found] : parts) {
      CAPTURE(parameter);
      std::vector<float> scaled = expected.at(parameter);
      for (float& value : scaled) value *= 0.1f;
      CHECK(error_of(found, scaled) < 1e-5);
    }
  }
}

TEST_CASE("what growth goes by are the views of all shares") {
  // What stands still shows the same gaussians in three steps as in the three shares of one.
  const Settings still = {{"train.rate_means", "0"},  {"train.rate_first", "0"},     {"train.rate_rest", "0"},
                          {"train.rate_scales", "0"}, {"train.rate_rotations", "0"}, {"train.rate_opacities", "0"},
                          {"background", "black"}};
  const auto views_after = [&](int64_t shares, int64_t steps) {
    const auto method = small_method("splat", still);
    Optimiser optimiser(method->parameters(), method->groups());
    SharedSteps shared({alone(), shares});
    for (int64_t step = 1; step <= steps; ++step) {
      shared.take(*method, optimiser, {step, 30000, 1});
      method->after_step({step, 30000, 1});
    }
    const TensorMap state = method->state();
    return std::pair(numbers_in(state.at("views")), numbers_in(state.at("gradient_sums")));
  };
  const auto [views, sums] = views_after(3, 1);
  const auto [views_by_steps, sums_by_steps] = views_after(1, 3);
  CHECK(views == views_by_steps);
  CHECK(norm(views) > 0);
  CHECK(error_of(sums, sums_by_steps) < 1e-5);
}

TEST_CASE("trainings in two shares go on from every step to the same bytes") {
  for (const std::string name : {"nerf", "splat", "street-gaussians", "neurad", "zipnerf", "genassets", "diffusion"}) {
    CAPTURE(name);
    const auto look = [](Method& method) {
      std::vector<float> all;
      for (const auto& [parameter, tensor] : method.parameters())
        for (const float value : tensor.to_host()) all.push_back(value);
      return all;
    };
    check_resumes_from_every_step({[&] { return small_method(name); }, look, 3, 2});
  }
}

TEST_CASE("an ordered sum adds one share at a time, in order") {
  OrderedSum sum(alone());
  for (int again = 0; again < 2; ++again) {
    sum.begin();
    for (const float value : {1e8f, 1.f, 1.f, -1e8f}) sum.add(std::vector<float>{value, 3.f}, 1, {0.5f});
    // 5e7 + 0.5 is 5e7 in float32, twice; in another order the first would be 1.
    std::vector<float> all(2);
    sum.spread(all);
    CHECK(all == std::vector<float>{0.f, 6.f});
  }
}

namespace {

/// Two ranks in two threads of one process.
class InThreads final : public Ranks {
 public:
  struct Desk {
    std::barrier<> both{2};
    const std::vector<std::span<const std::byte>>* sent[2] = {};
  };
  InThreads(Desk& desk, int64_t rank, std::chrono::milliseconds pause = {}) : desk_(desk), rank_(rank), pause_(pause) {}
  int64_t rank() const override { return rank_; }
  int64_t size() const override { return 2; }
  void trade(const std::vector<std::span<const std::byte>>& to,
             const std::vector<std::span<std::byte>>& from) const override {
    desk_.sent[rank_] = &to;
    desk_.both.arrive_and_wait();
    const auto other = static_cast<size_t>(1 - rank_);
    const std::span<const std::byte> given = (*desk_.sent[other])[static_cast<size_t>(rank_)];
    CHECK(given.size() == from[other].size());
    std::ranges::copy(given, from[other].begin());
    desk_.both.arrive_and_wait();
    std::this_thread::sleep_for(pause_);
  }

 private:
  Desk& desk_;
  int64_t rank_;
  std::chrono::milliseconds pause_;
};

}  // namespace

TEST_CASE("two ranks add up half of the rows each, and end with all of them") {
  // 5 rows of 21: ranks have 2 and 3 of them, which is more than is added at a time, and no multiple. No share's -0 is
  // left.
  constexpr int kAll = 5 * 21, kFirst = 2 * 21;
  InThreads::Desk desk;
  std::vector<float> all[2] = {std::vector<float>(kAll), std::vector<float>(kAll)};
  std::vector<float> own[2];
  const auto one = [&](int rank) {
    const InThreads ranks(desk, rank);
    const auto share_of = [&](float scale) {
      std::vector<float> values;
      for (int i = 0; i < kAll; ++i)
        values.push_back(i == kAll - 1 ? -0.f : scale * static_cast<float>(i + kAll * rank));
      return values;
    };
    OrderedSum sum(ranks), in_place(ranks);
    for (const float scale : {1.f, 100.f}) sum.add(share_of(scale), 5, {0.25f, 0.5f});
    sum.spread(all[rank]);
    in_place.add(share_of(1), 5, {0.25f, 0.5f});
    std::vector<float> last = share_of(100);
    const size_t begin = rank == 0 ? 0 : kFirst, end = rank == 0 ? kFirst : kAll;
    const std::span values(last);
    const std::span<float> place = values.subspan(begin, end - begin);
    in_place.add_last({values.first(begin), place, values.subspan(end)}, place, 5, {0.25f, 0.5f});
    own[rank].assign(place.begin(), place.end());
    const std::vector<float> given = share_of(100);  // the other rank's rows stay as they were
    const size_t theirs = rank == 0 ? kFirst : 0;
    CHECK(std::equal(&last[theirs], &last[theirs] + (kAll - (end - begin)), &given[theirs]));
  };
  std::thread other(one, 1);
  one(0);
  other.join();
  std::vector<float> expected;
  for (int i = 0; i < kAll - 1; ++i)
    expected.push_back(101.f * (0.25f * static_cast<float>(i) + 0.5f * static_cast<float>(i + kAll)));
  expected.push_back(0);
  CHECK(all[0] == expected);
  CHECK(all[1] == expected);
  CHECK_FALSE(std::signbit(all[0].back()));
  CHECK(own[0] == std::vector<float>(expected.begin(), expected.begin() + kFirst));
  CHECK(own[1] == std::vector<float>(expected.begin() + kFirst, expected.end()));
}

TEST_CASE("ranks of one host have memory in common, unless one of them does not want it") {
  constexpr size_t kBytes = 3 << 20;
  InThreads::Desk desk;
  const auto one = [&](int rank) {
    const InThreads ranks(desk, rank);
    CHECK(shared_memory(ranks, kBytes, rank == 0) == nullptr);
    const auto memory = shared_memory(ranks, kBytes, true);
    REQUIRE(memory != nullptr);
    const auto at = [&](int of) { return memory.get() + (of == 0 ? 0 : kBytes - 1); };
    CHECK(*at(rank) == std::byte{0});
    meet(ranks);
    *at(rank) = std::byte{static_cast<unsigned char>(7 + rank)};
    meet(ranks);
    CHECK(*at(1 - rank) == std::byte{static_cast<unsigned char>(8 - rank)});
  };
  std::thread other(one, 1);
  one(0);
  other.join();
  CHECK(shared_memory(alone(), kBytes, true) == nullptr);
  CHECK(shared_memory(PretendedRanks(2), kBytes, true) == nullptr);
}

TEST_CASE("ranks with memory in common take the steps of two shares, however late one of them is") {
  constexpr int64_t kSteps = 3;
  const auto trained = [&](const Ranks& ranks) {
    const auto method = small_method("nerf");
    Optimiser optimiser(method->parameters(), method->groups(), ranks);
    CHECK((optimiser.in_common(0) != nullptr) == (ranks.size() > 1 && computes_in_host_memory()));
    SharedSteps steps({ranks, 2});
    Values out;
    for (int64_t step = 1; step <= kSteps; ++step) {
      steps.take(*method, optimiser, {step, 10, 1});
      // Methods replace parameters between steps.
      for (const auto& [name, tensor] : method->parameters()) {
        assign({{tensor, tensor * 1.5f}});
        out[name] = tensor.to_host();
      }
    }
    meet(ranks);
    return out;
  };
  const Values alone_in_turn = trained(alone());
  for (const int late : {0, 1}) {
    CAPTURE(late);
    InThreads::Desk desk;
    Values of_rank[2];
    const auto one = [&](int rank) {
      of_rank[rank] = trained(InThreads(desk, rank, std::chrono::milliseconds(rank == late ? 20 : 0)));
    };
    if (!computes_in_host_memory()) return;  // messages hold the one device that both threads have
    std::thread other(one, 1);
    one(0);
    other.join();
    CHECK(of_rank[0] == alone_in_turn);
    CHECK(of_rank[1] == alone_in_turn);
  }
}
