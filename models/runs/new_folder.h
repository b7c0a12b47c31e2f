// A folder that is new: what writes many files begins with it.
#pragma once
#include <filesystem>
#include <optional>

#include "models/io/commit.h"

namespace cloam {

/// Fault::usage for a folder that holds anything.
void check_new_folder(const std::filesystem::path& folder);

/// Made, and held for this process; removed again where nothing is in it at the end. Fault::usage if it holds anything
/// or another process holds it.
class NewFolder {
 public:
  explicit NewFolder(const std::filesystem::path& folder);
  ~NewFolder();
  NewFolder(const NewFolder&) = delete;
  NewFolder& operator=(const NewFolder&) = delete;

 private:
  std::filesystem::path folder_;
  std::optional<FolderLock> lock_;
};

}  // namespace cloam
