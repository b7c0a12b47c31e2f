// See new_folder.h.
#include "models/runs/new_folder.h"

#include <algorithm>

#include "models/io/paths.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

bool is_lock(const fs::path& file) { return file.filename() == ".lock"; }

}  // namespace

void check_new_folder(const fs::path& folder) {
  std::error_code error;
  if (!fs::exists(folder, error)) return;
  const std::vector<fs::path> held = entries_of(folder);  // a lock is another's who writes there: FolderLock tells
  if (fs::is_directory(folder, error) && std::all_of(held.begin(), held.end(), is_lock)) return;
  throw Error(Fault::usage, text(folder.string(), " exists; name a new folder with -o"));
}

NewFolder::NewFolder(const fs::path& folder) : folder_(folder) {
  check_new_folder(folder);  // a file in its place
  lock_.emplace(folder);
  check_new_folder(folder);  // another process may have filled it meanwhile
}

NewFolder::~NewFolder() {
  lock_.reset();
  std::error_code error;
  fs::remove(folder_, error);
}

}  // namespace cloam
