// A peer: a program that times another library on the works that ours are compared by. It sees no code of ours: the
// harness starts it as a child, with the environment that is best for it, and lets it take turns with ours.
//
//   int main() {
//     return peer::serve("a library 1.2", {{"matmul.512.nn", [] {
//                          auto state = inputs();
//                          return [state] { multiply(*state); };
//                        }}});
//   }
//
// Line by line on stdin and stdout (what a library prints on stdout goes to stderr):
//   library        ->  what is timed and its version
//   list           ->  the names of all works, in one line
//   sample NAME    ->  milliseconds of one run, or "error: why"
// A work is prepared and warmed up when it is first sampled, and dropped when another is. Ways to do the same work are
// works called NAME@way: the harness takes the fastest, and they are kept together.
#pragma once
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <functional>
#include <iostream>
#include <map>
#include <string>
#include <vector>

namespace peer {

using Run = std::function<void()>;  // does the work once and returns when it is done

struct Work {
  std::string name;              // as the workload of ours: sizes in the name
  std::function<Run()> prepare;  // makes the inputs; not timed
};
using Works = std::vector<Work>;

/// "conv.3x3.64.128.b8.fwd" -> conv, 3x3, 64, 128, b8, fwd; a "@way" at the end is left out.
inline std::vector<std::string> fields(const std::string& name, char separator = '.') {
  std::vector<std::string> out(1);
  for (char c : name.substr(0, name.find('@')))
    if (c == separator)
      out.emplace_back();
    else
      out.back() += c;
  return out;
}

/// One sample is as many runs as last about 20 ms; how many is found once.
class Sampler {
 public:
  explicit Sampler(Run run) : run_(std::move(run)) {
    double last = seconds(1);
    for (int i = 0; i < 1 || (i < 8 && last * i < 0.2); i++) last = seconds(1);
    repeats_ = std::clamp(static_cast<int>(0.02 / std::max(last, 1e-6)) + 1, 1, 1000);
  }
  double milliseconds() const { return 1e3 * seconds(repeats_) / repeats_; }

 private:
  double seconds(int repeats) const {
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < repeats; i++) run_();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }
  Run run_;
  int repeats_ = 1;
};

class Server {
 public:
  Server(std::string library, Works works) : library_(std::move(library)), works_(std::move(works)) {}

  std::string answer(const std::string& line) {
    if (line == "library") return library_;
    if (line == "list") return list();
    if (line.starts_with("sample ")) return sample(line.substr(7));
    return "error: unknown request " + line;
  }

 private:
  std::string list() const {
    std::string names;
    for (const Work& work : works_) names += (names.empty() ? "" : " ") + work.name;
    return names;
  }

  std::string sample(const std::string& name) try {
    const auto work = std::find_if(works_.begin(), works_.end(), [&](const Work& w) { return w.name == name; });
    if (work == works_.end()) return "error: no work is called " + name;
    const auto base = [](const std::string& s) { return s.substr(0, s.find('@')); };
    if (!ready_.empty() && base(ready_.begin()->first) != base(name)) ready_.clear();
    if (!ready_.contains(name)) ready_.emplace(name, Sampler(work->prepare()));
    return std::to_string(ready_.at(name).milliseconds());
  } catch (const std::exception& e) {
    const std::string why = e.what();
    return "error: " + why.substr(0, why.find('\n'));
  }

  std::string library_;
  Works works_;
  std::map<std::string, Sampler> ready_;
};

/// Answers until stdin ends. library: what is timed, with its version.
inline int serve(const std::string& library, Works works) {
  std::FILE* answers = fdopen(dup(STDOUT_FILENO), "w");
  dup2(STDERR_FILENO, STDOUT_FILENO);
  Server server(library, std::move(works));
  for (std::string line; std::getline(std::cin, line);) {
    std::fprintf(answers, "%s\n", server.answer(line).c_str());
    std::fflush(answers);
  }
  return 0;
}

}  // namespace peer
