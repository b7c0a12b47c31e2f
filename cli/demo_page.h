// What a demo made, as a page for people: one HTML file that holds its pictures and needs nothing else.
#pragma once
#include <atomic>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

namespace cloam {

struct DemoCommand {
  std::string line;  // as typed at a prompt
  double seconds;
};

/// Where the parts of a demo lie.
struct DemoFolders {
  std::filesystem::path root;
  std::filesystem::path page() const { return root / "index.html"; }
  std::filesystem::path record() const { return root / "demo.json"; }
  std::filesystem::path first() const { return root / "first"; }  // assets of the prior that comes with the program
  std::filesystem::path logs() const { return root / "logs"; }
  std::filesystem::path street() const { return root / "street"; }  // run of genassets
  std::filesystem::path prior() const { return root / "prior"; }    // run of diffusion
  std::filesystem::path training() const { return root / "training"; }
  std::filesystem::path samples() const { return root / "samples"; }
  std::filesystem::path gaussian() const { return root / "gaussian"; }
  std::filesystem::path random() const { return root / "random"; }
  std::filesystem::path assets() const { return root / "assets"; }  // a folder a class and time of day
  std::filesystem::path before() const { return root / "before"; }
  std::filesystem::path edited() const { return root / "edited"; }  // run with swapped vehicles
  std::filesystem::path after() const { return root / "after"; }
};

struct DemoRecord {  // NOLINT(bugprone-exception-escape): what moving JSON throws ends the program
  DemoFolders folders;
  nlohmann::ordered_json street, prior;              // what eval found
  nlohmann::ordered_json samples, gaussian, random;  // distances to the training assets
  std::string swapped_log;
  std::vector<std::string> swapped;  // ids of its actors
  std::vector<DemoCommand> commands;
};

/// What there is to see while a demo goes on.
struct DemoProgress {
  DemoFolders folders;
  std::vector<std::string> parts;  // in words
  std::size_t now = 0;             // the number of the part that is being made, from 0
  bool is_over = false;            // it ended before the last part
};

/// Writes folders.page() with what lies in the folders so far; it reads itself again every few seconds until is_over.
/// Files that are missing or not whole are left out. Fault::write.
void write_progress_page(const DemoProgress& progress);

/// Writes the page of a demo again and again, on a thread of its own, as long as it lives. At its end the page says
/// that the demo ended early, unless end() came before.
class GrowingPage {
 public:
  explicit GrowingPage(DemoProgress progress);
  ~GrowingPage();
  GrowingPage(const GrowingPage&) = delete;
  GrowingPage& operator=(const GrowingPage&) = delete;

  void begin_part(std::size_t part) { now_ = part; }
  /// Others write the page from here on.
  void end();

 private:
  void keep_writing(const std::stop_token& stop);
  void write() noexcept;

  DemoProgress progress_;
  std::atomic<std::size_t> now_ = 0;
  std::jthread writer_;
};

/// Writes folders.page(). Fault::data for pictures that are missing; Fault::write.
void write_demo_page(const DemoRecord& record);

/// The Frechet distance in what `distance --json` prints, whatever the network.
double frechet_of(const nlohmann::ordered_json& distance);

}  // namespace cloam
