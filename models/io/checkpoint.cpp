// latest.txt is a hint, the file names are the truth: a lost or damaged hint costs nothing.
#include "models/io/checkpoint.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <optional>
#include <vector>

#include "models/io/commit.h"
#include "models/io/packed_tensors.h"
#include "models/io/paths.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

constexpr size_t kKept = 3;

std::string checkpoint_name(int64_t step) { return fmt::format("{:06}.safetensors", step); }

std::optional<int64_t> step_of(const std::string& name) {
  const auto step = number_in<int64_t>(std::string_view(name).substr(0, name.find('.')));
  return step && *step >= 0 && checkpoint_name(*step) == name ? step : std::nullopt;
}

/// Steps that have a checkpoint, newest first.
std::vector<int64_t> list_steps(const fs::path& folder) {
  std::vector<int64_t> steps;
  for (const fs::path& entry : entries_of(folder)) {
    if (const auto step = step_of(entry.filename().string())) steps.push_back(*step);
  }
  std::sort(steps.rbegin(), steps.rend());
  return steps;
}

std::optional<int64_t> latest_step(const fs::path& folder) {
  std::string name;
  std::ifstream(folder / "latest.txt") >> name;
  return step_of(name);
}

std::string describe(const fs::path& folder) {
  if (!fs::is_directory(folder)) return "there is no such folder";
  const size_t checkpoints = list_steps(folder).size(), others = entries_of(folder).size() - checkpoints;
  return text("found ", checkpoints, " checkpoints (NNNNNN.safetensors) and ", others, " other files");
}

void prune(const fs::path& folder, int64_t saved) {
  size_t kept = 0;
  std::error_code ignored;
  for (const int64_t step : list_steps(folder)) {
    const bool keep = step <= saved && kept++ < kKept;
    if (!keep) fs::remove(folder / checkpoint_name(step), ignored);
  }
}

void verify(const fs::path& path, const SafetensorsFile& file) {
  try {
    if (reads_back(path, file)) return;
  } catch (const Error& problem) {
    throw Error(Fault::write, text("the checkpoint cannot be read back: ", problem.what()));
  }
  throw Error(Fault::write, text("the checkpoint ", path.string(), " reads back with other values; check this disk"));
}

}  // namespace

fs::path save_checkpoint(const fs::path& folder, int64_t step, const SafetensorsFile& file) {
  if (step < 0) throw Error(Fault::internal, text("checkpoint of the negative step ", step));
  remove_stale_temporaries(folder);
  const fs::path path = folder / checkpoint_name(step);
  write_safetensors(path, file);
  verify(path, file);
  commit_text(folder / "latest.txt", checkpoint_name(step) + "\n");
  prune(folder, step);
  return path;
}

bool has_checkpoints(const fs::path& folder) { return !list_steps(folder).empty(); }

LoadedCheckpoint load_latest_checkpoint(const fs::path& folder) {
  std::vector<int64_t> steps = list_steps(folder);
  if (const auto latest = latest_step(folder)) {
    std::erase(steps, *latest);
    steps.insert(steps.begin(), *latest);
  }
  std::string damage;
  for (const int64_t step : steps) {
    const fs::path path = folder / checkpoint_name(step);
    try {
      LoadedCheckpoint loaded{step, path, unpack(read_safetensors(path)), ""};
      if (!damage.empty()) loaded.warning = text("skipped ", damage, "; continuing from step ", step);
      return loaded;
    } catch (const Error& problem) { damage += (damage.empty() ? "" : "; ") + std::string(problem.what()); }
  }
  bad_data("no usable checkpoint in ", folder.string(), ": ", describe(folder), damage.empty() ? "" : "; ", damage,
           "; train first, or name another run folder");
}

}  // namespace cloam
