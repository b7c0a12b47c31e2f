// The property that every method owes to whoever stops and goes on: a checkpoint holds all that the next step and a
// render read. One training saves each of its steps; from each of them one step is made anew and held against the next.
#pragma once
#include <doctest/doctest.h>

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "models/train/trainer.h"
#include "tests/models/folder.h"

namespace cloam {

struct Resumable {
  /// A method as a program that was started anew has it: built, with its data.
  std::function<std::unique_ptr<Method>()> make;
  /// What a user sees of it: a render, samples.
  std::function<std::vector<float>(Method&)> look;
  int64_t steps = 80;
  int64_t shares = 1;  // of each step's batch
};

struct SavedStep {
  SafetensorsFile file;
  std::vector<float> look;
};

/// Every step of one training, with what it looked like then.
inline std::vector<SavedStep> train_step_by_step(const Resumable& what, const std::filesystem::path& folder) {
  const auto method = what.make();
  std::vector<SavedStep> saved;
  TrainOptions options;
  options.steps = what.steps;
  options.shares = what.shares;
  options.save_every = 1;
  TrainListener listener;
  listener.checkpoint = [&](int64_t, const std::filesystem::path& path) {
    saved.push_back({read_safetensors(path), what.look(*method)});
  };
  train({*method, folder, {}, nullptr, nullptr}, options, listener);
  return saved;
}

/// What differs: names of tensors, their number, the metadata; "" if nothing does.
inline std::string differences(const SafetensorsFile& a, const SafetensorsFile& b) {
  std::string found;
  for (const auto& [name, tensor] : a.tensors)
    if (!b.tensors.contains(name) || !(b.tensors.at(name) == tensor)) found += " " + name;
  if (a.tensors.size() != b.tensors.size()) found += " the number of tensors";
  if (a.metadata != b.metadata) found += " the metadata";
  return found;
}

inline void check_resumes_from_every_step(const Resumable& what) {
  const Folder folder;
  const std::vector<SavedStep> saved = train_step_by_step(what, folder.path / "whole");
  REQUIRE(saved.size() == static_cast<size_t>(what.steps));
  for (size_t i = 0; i + 1 < saved.size(); ++i) {
    const int64_t step = static_cast<int64_t>(i) + 1;
    CAPTURE(step);
    const auto method = what.make();
    restore_method(*method, saved[i].file);
    REQUIRE_MESSAGE(what.look(*method) == saved[i].look, "a render after restoring differs");
    TrainOptions options;
    options.steps = what.steps;
    options.shares = what.shares;
    options.stop_after = step + 1;
    const auto path = train({*method, folder.path / "again", {}, &saved[i].file, nullptr}, options, {}).checkpoint;
    const std::string other = differences(read_safetensors(path), saved[i + 1].file);
    REQUIRE_MESSAGE(other.empty(), "the step after differs in:", other);
  }
}

}  // namespace cloam
