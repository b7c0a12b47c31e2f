// Scripts for Python's module, installed into a clean prefix.
#pragma once
#include <doctest/doctest.h>

#include <cstdlib>

#include "tests/cli/process.h"

#ifdef CLOAM_PYTHON

namespace cloam::python_program {

namespace fs = std::filesystem;

inline fs::path folder() { return scratch() / "python"; }

/// Where the module lies, installed once.
inline const std::string& module_path() {
  static const std::string place = [] {
    const fs::path prefix = folder() / "prefix";
    fs::create_directories(prefix);
    const std::string build = fs::path(CLOAM_BINARY).parent_path().parent_path().string();
    const std::string install = "cmake --install " + build + " --prefix " + prefix.string() + " --component python";
    REQUIRE(std::system((install + " > " + (folder() / "install.log").string()).c_str()) == 0);
    return (prefix / "lib/python3/dist-packages").string();
  }();
  return place;
}

/// A script, with `import cloam` and such before it, on words; what it prints.
inline Outcome python(const std::string& script, const Words& words = {}) {
  static int count = 0;
  const fs::path file = folder() / ("script" + std::to_string(++count) + ".py"), out = folder() / "out";
  const std::string path = module_path();
  write_text(file, "import sys, threading\nimport numpy as np\nimport cloam\n" + script);
  std::string command = "PYTHONPATH=" + path + " " CLOAM_PYTHON " " + file.string();
  for (const std::string& word : words) command += " '" + word + "'";
  const int status = std::system((command + " > " + out.string() + " 2>&1").c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, content_of(out), "", 0};
}

inline std::string printed(const std::string& script, const Words& words = {}) {
  const Outcome outcome = python(script, words);
  REQUIRE_MESSAGE(outcome.code == 0, outcome.out);
  return outcome.out;
}

}  // namespace cloam::python_program

#endif
