// The program: parses, runs one command, turns errors into one message and an exit code (docs/formats.md).
#include <csignal>
#include <cstdio>
#include <exception>
#include <new>
#include <stdexcept>

#include "cli/profile.h"
#include "cli/run_words.h"
#include "models/data/paths.h"
#include "runtime/error.h"

namespace cloam {
namespace {

constexpr char kIntroduction[] =
    R"(cloam makes 3D scenes from photos on any OpenCL device. It needs no CUDA and no Python.

  cloam demo                                     ten minutes: from streets that it makes itself to new cars in them
  cloam info                                     which devices there are, and which one would run
  cloam process PHOTOS -o DATA                   find the camera poses of photos (with COLMAP)
  cloam check DATA                               is this folder a capture that can be trained?
  cloam train nerf DATA -o runs/my               learn the scene (Ctrl-C saves; --resume goes on)
  cloam train nerf DATA -o runs/my --time-budget 5m
  cloam eval runs/my                             PSNR and SSIM on photos that were held out
  cloam compare runs/my runs/other               the figures of several runs side by side
  cloam distance samples photos --features FILE  FID and KID of two folders of pictures
  cloam render runs/my -o pictures --path orbit  new views, and a turntable
  cloam synth -o streets                         invented driving logs, with masks, depth and turned actors as truth
  cloam edit runs/street --list                  the actors of a street; --actor moves, turns, removes, swaps them
  cloam simulate runs/edited -o logs/edited      the edited street as a log: images, LiDAR and boxes
  cloam export runs/street --actor ID -o car.glb an actor as a mesh
  cloam convert scene.ply scene.spz              Gaussian splats from one file format to another
  cloam train diffusion runs/street -o runs/new  learn what such actors are like ...
  cloam generate runs/new -n 8 -o cars           ... and make new ones: pictures and meshes
  cloam selftest --quick                         does this device compute right?
  cloam bench                                    how fast is it here?

DATA is what process makes, or any capture with a sparse model of COLMAP's; a folder with transforms.json (instant-ngp,
nerfstudio) or transforms_train.json (NeRF-synthetic); a driving log.
"cloam COMMAND --help" shows examples and options.
)";

int report(int code, std::string message) {
  const std::string tag = "  [exit " + std::to_string(code) + "]";
  const std::size_t line_end = std::min(message.find('\n'), message.size());
  message.insert(line_end, tag);
  std::fprintf(stderr, "error: %s\n", message.c_str());
  return code;
}

std::vector<std::string> option_names(const CLI::App& parser) {
  std::vector<std::string> names;
  for (const CLI::Option* option : parser.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

std::string did_you_mean(const std::string& word, const std::vector<std::string>& names) {
  const std::string near = nearest_name(word.substr(0, word.find('=')), names);
  return near.empty() ? "" : "; did you mean " + near + "?";
}

int unknown_words(const CLI::App& program) {
  for (const CLI::App* command : program.get_subcommands()) {
    for (const std::string& word : command->remaining()) {
      const std::string kind = word[0] == '-' ? " has no option " : " takes no argument ";
      return report(2, "cloam " + command->get_name() + kind + word + did_you_mean(word, option_names(*command)) +
                           "\n  see cloam " + command->get_name() + " --help");
    }
  }
  std::vector<std::string> names;
  for (const CLI::App* command : program.get_subcommands({})) names.push_back(command->get_name());
  const std::vector<std::string> words = program.remaining();
  const std::string word = words.empty() ? "" : words.front();
  return report(2, "there is no command " + word + did_you_mean(word, names) + "\n  see cloam --help");
}

int parse(CLI::App& program, int argc, char** argv) {
  try {
    program.parse(argc, argv);
    return -1;
  } catch (const CLI::ExtrasError&) { return unknown_words(program); } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return program.exit(error);  // --help, --version
    return report(2, error.what());
  }
}

int run(const std::function<int()>& command) {
  try {
    const int code = command();
    end_profile();
    return code;
  } catch (const Error& error) {
    return report(static_cast<int>(error.fault()), error.what());
  } catch (const std::bad_alloc&) {
    return report(5, "the machine's memory is full; a larger --downscale needs less");
  } catch (const std::length_error&) {
    return report(5, "a size is beyond what any memory holds; smaller sizes among the settings or in the data fit");
  } catch (const std::exception& error) {
    return report(1, std::string("internal error: ") + error.what() +
                         "\n  please report this with the command and the output of cloam info");
  }
}

int main_of(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);  // a reader of our output that goes away must not end a training
  seconds_since_start();
  command_line() = typed({argv + 1, argv + argc});
  if (argc == 1) {
    return run([] {
      put(kIntroduction);
      return 0;
    });
  }
  CLI::App program("3D scenes from photos on any OpenCL device", "cloam");
  program.set_version_flag("--version", std::string("cloam ") + kVersion);
  program.require_subcommand(0, 1);
  const std::vector<Command> commands = add_commands(program);
  const int parsed = parse(program, argc, argv);
  if (parsed >= 0) return parsed;
  for (const Command& command : commands) {
    if (command.parser->parsed()) return run(command.run);
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
