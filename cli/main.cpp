// The program: parses, runs one command, turns errors into one message and an exit code (docs/formats.md).
#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <exception>
#include <map>

#include "cli/commands.h"
#include "cli/failure.h"
#include "cli/ranks.h"
#include "cli/stop_signal.h"
#include "models/io/words.h"
#include "runtime/error.h"
#include "runtime/watchdog.h"

namespace cloam {
namespace {

constexpr char kIntroduction[] =
    R"(cloam makes 3D scenes from photos on any OpenCL device. It needs no CUDA and no Python.

See what it does:
  cloam demo                                      the whole pipeline on synthetic streets, in about 12 minutes
Photos:
  cloam process PHOTOS -o DATA                    find the camera poses of photos, with COLMAP
  cloam check DATA                                can this folder be trained on?
  cloam train nerf DATA -o runs/my                learn the scene; Ctrl-C saves, --resume continues
  cloam train splat DATA -o runs/my --time-budget 5m
  cloam eval runs/my                              PSNR and SSIM on held-out photos
  cloam report runs/my                            one page: curves, pictures, metrics
  cloam render runs/my -o pictures --path orbit   new views, and a turntable
  cloam view runs/my                              look around in the browser
  cloam export runs/my -o scene.ply               Gaussian splats as a file
  cloam convert scene.ply scene.spz               ... in another format
Driving logs:
  cloam synth -o logs                             make synthetic logs to try it with
  cloam train genassets logs/001 -o runs/street   reconstruct the street and its actors
  cloam edit runs/street --list                   list the actors; --actor moves, turns, removes or replaces them
  cloam simulate runs/edited -o logs/edited       write the edited street as a log: images, LiDAR and boxes
  cloam train diffusion runs/street -o runs/new   learn what the actors are like ...
  cloam generate runs/new -n 8 -o cars            ... and make new ones: pictures and meshes
Measure:
  cloam compare runs/my runs/other                metrics of several runs side by side
  cloam tables --size small -o tables             the GenAssets paper's tables: all rows, beside the paper's
  cloam distance samples photos --features FILE   FID and KID between two folders of images
  cloam crops logs/001 -o crops                   the actors of driving logs as images, filtered as in GenAssets
  cloam info                                      the devices, and which one is used
  cloam doctor                                    why is a device missing, or not working?
  cloam selftest --quick                          does this device compute correctly?
  cloam bench                                     how fast is it? (cloam tune makes it faster)
  cloam config show nerf                          every setting; cloam config diff compares runs
  cloam completion bash                           completes words in a shell; also zsh, fish, and a man page

DATA is a folder that process made, one with a COLMAP model, transforms.json (instant-ngp, nerfstudio) or
transforms_train.json (NeRF-synthetic), poses_bounds.npy (LLFF), or a driving log (PandaSet, KITTI raw,
nuScenes, Waymo as plain files, rig.json).
"cloam help COMMAND" shows examples and options.
)";

int report(int code, std::string message) {
  const std::string tag = "  [exit " + std::to_string(code) + "]";
  const std::size_t line_end = std::min(message.find('\n'), message.size());
  message.insert(line_end, tag);
  await_first_rank();
  std::fprintf(stderr, "error: %s%s\n", rank_words().c_str(), message.c_str());
  end_ranks(code);
  return code;
}

std::vector<std::string> option_names(const CLI::App& parser) {
  std::vector<std::string> names;
  for (const CLI::Option* option : parser.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

/// What options are called in other programs.
const std::map<std::string, std::string> kElsewhere = {{"--iterations", "--steps"},
                                                       {"--max-num-iterations", "--steps"},
                                                       {"--total-steps", "--steps"},
                                                       {"--max-steps", "--steps"},
                                                       {"--output", "--out"},
                                                       {"--output-dir", "--out"},
                                                       {"--model_path", "--out"},
                                                       {"--resolution", "--downscale"},
                                                       {"--data-factor", "--downscale"},
                                                       {"--test-every", "--holdout"}};

std::string hint(const std::string& word, const std::vector<std::string>& names) {
  const auto elsewhere = kElsewhere.find(word.substr(0, word.find('=')));
  const bool known =
      elsewhere != kElsewhere.end() && std::find(names.begin(), names.end(), elsewhere->second) != names.end();
  if (known) return "; here it is called " + elsewhere->second;
  return did_you_mean(word.substr(0, word.find('=')), names);
}

int unknown_words(const CLI::App& program) {
  for (const CLI::App* command : program.get_subcommands()) {
    for (const std::string& word : command->remaining()) {
      const std::string kind = word[0] == '-' ? " has no option " : " takes no argument ";
      return report(2, "cloam " + command->get_name() + kind + word + hint(word, option_names(*command)) +
                           "\n  see cloam " + command->get_name() + " --help");
    }
  }
  std::vector<std::string> names;
  for (const CLI::App* command : program.get_subcommands({})) names.push_back(command->get_name());
  const std::vector<std::string> words = program.remaining();
  const std::string word = words.empty() ? "" : words.front();
  return report(2, "unknown command " + word + hint(word, names) + "\n  see cloam --help");
}

int introduce() {
  put(kIntroduction);
  return 0;
}

/// `help COMMAND` and `version` are what people try first; CLI11 knows `COMMAND --help` and `--version`.
std::vector<std::string> spelled_out(std::vector<std::string> words) {
  if (words.front() == "version") words.front() = "--version";
  if (words.front() != "help") return words;
  words.erase(words.begin());
  words.push_back("--help");
  return words;
}

int parse(CLI::App& program, const std::vector<std::string>& words) {
  try {
    program.parse(std::vector<std::string>(words.rbegin(), words.rend()));  // in the order in which CLI11 takes them
    return -1;
  } catch (const CLI::ExtrasError&) { return unknown_words(program); } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() != 0) return report(2, complaint(error, program));
    if (!program.get_subcommands().empty() || program.count("--version") > 0) return program.exit(error);
    return program.remaining().empty() ? introduce() : unknown_words(program);
  }
}

int run(const std::string& name, const std::function<int()>& command) {
  on_hang([](const std::string& message) { report(static_cast<int>(Fault::device), message); });
  try {
    join_ranks();
    check_can_share(name);
    take_gpu_in_turn();
    const int code = command();
    end_profile();
    leave_ranks();
    return code;
  } catch (const Interrupted& interrupted) {
    await_first_rank();
    std::fprintf(stderr, "%s\n", interrupted.what());
    end_ranks(interrupted.code());
    return interrupted.code();
  } catch (...) {
    const Error error = current_error();
    return report(static_cast<int>(error.fault()), error.what());
  }
}

int main_of(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);  // a reader of our output that goes away must not end a training
  seconds_since_start();
  const std::vector<std::string> words(argv + 1, argv + argc);
  command_line() = typed(words);
  if (words.empty()) return run("", introduce);
  CLI::App program("3D scenes from photos on any OpenCL device", "cloam");
  program.set_version_flag("--version", std::string("cloam ") + kVersion);
  program.require_subcommand(0, 1);
  const std::vector<Command> commands = add_commands(program);
  const int parsed = parse(program, spelled_out(words));
  if (parsed >= 0) return parsed;
  for (const Command& command : commands) {
    if (command.parser->parsed()) return run(command.parser->get_name(), command.run);
  }
  return unknown_words(program);
}

}  // namespace
}  // namespace cloam

int main(int argc, char** argv) {
  try {
    return cloam::main_of(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s  [exit 1]\n", error.what());
    return 1;
  }
}
