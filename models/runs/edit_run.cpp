// See edit_run.h.
#include "models/runs/edit_run.h"

#include "models/io/commit.h"
#include "models/runs/new_folder.h"
#include "models/runs/scene_file.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

/// The same folder, from another run folder.
RunData moved(RunData data, const fs::path& from, const fs::path& to) {
  std::error_code error;
  data.relative = relative_to_run(fs::weakly_canonical(from, error) / data.relative, to);
  return data;
}

void write_files(const StoredRun& edited, const fs::path& to, const std::string& command_line) {
  const fs::path& from = edited.folder;
  RunRecord record = edited.record;
  const RunPaths paths{to};
  if (edited.checkpoint.path.empty()) {
    save_checkpoint(paths.checkpoints(), edited.checkpoint.step, edited.checkpoint.file);
  } else {
    const std::string name = edited.checkpoint.path.filename().string();
    commit_link(edited.checkpoint.path, paths.checkpoints() / name);
    commit_text(paths.checkpoints() / "latest.txt", name + "\n");
  }
  if (fs::exists(RunPaths{from}.config())) commit_link(RunPaths{from}.config(), paths.config());
  if (!edited.generated.assets.empty()) write_new_assets(paths.generated(), edited.generated);
  write_scenes(paths.scene(), edited.scenes);
  for (RunData& data : record.data) data = moved(data, from, to);
  if (record.networks) record.networks = moved(*record.networks, from, to);
  record.edited_from = RunData{from.string(), relative_to_run(from, to), ""};
  record.command_line = command_line;
  write_record(to, record);  // last: from now on it is a run
}

}  // namespace

void write_edited_run(const StoredRun& edited, const fs::path& to, const std::string& command_line) {
  const NewFolder folder(to);
  try {
    write_files(edited, to, command_line);
  } catch (...) {
    std::error_code error;
    std::filesystem::remove_all(to, error);  // all of it is ours; half a run would bar the way of the next try
    throw;
  }
}

}  // namespace cloam
