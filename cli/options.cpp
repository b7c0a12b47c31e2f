// See options.h.
#include "cli/options.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <map>
#include <sstream>

#include "models/io/commit.h"
#include "models/io/words.h"
#include "runtime/error.h"

namespace cloam {

struct WordCheck {
  CLI::Validator validator;
  std::vector<std::string> words = {};  // that it takes, if it is by a list
};

namespace {

template <class Value>
bool read_whole(const std::string& word, Value& value) {
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc() && end == word.data() + word.size();
}

/// "above 0", "of 2 or more", "from 1 to 256".
std::string range_words(int64_t least, int64_t most) {
  if (most < std::numeric_limits<int64_t>::max()) return text("from ", least, " to ", most);
  return least == 1 ? "above 0" : text("of ", least, " or more");
}

/// A check without a description, which --help would show.
Check check(std::function<std::string(std::string&)> wrong) {
  return std::make_shared<WordCheck>(WordCheck{CLI::Validator(std::move(wrong), "")});
}

/// What Option::offers said.
std::map<const CLI::Option*, std::vector<std::string>>& offers() {
  static std::map<const CLI::Option*, std::vector<std::string>> all;
  return all;
}

std::string either(const std::vector<std::string>& words) {
  std::string out;
  for (std::size_t i = 0; i < words.size(); ++i) out += (i == 0 ? "" : i + 1 < words.size() ? ", " : " or ") + words[i];
  return out;
}

/// The first of a command's examples; its description begins with them.
std::string example_of(const CLI::App& command) {
  const std::string& description = command.get_description();
  const std::string head = "Examples:\n  ";
  const std::size_t at = description.find(head);
  if (at == std::string::npos) return "";
  const std::size_t begin = at + head.size(), end = description.find('\n', begin);
  const std::string line = description.substr(begin, end - begin);
  return "\n  example: " + line.substr(0, std::min(line.find("   "), line.find("  #")));
}

std::string help_of(const CLI::App& command) { return "\n  see cloam " + command.get_name() + " --help"; }

/// What is wanted for an option or argument that is missing or has no value.
std::string missing(const CLI::App& command, const std::string& name, const std::string& verb) {
  const CLI::Option* option = command.get_option_no_throw(name);
  return verb + " " + name + (option ? ": " + option->get_description() : "") + example_of(command) + help_of(command);
}

class HelpFormat : public CLI::Formatter {
 public:
  HelpFormat() {
    column_width(28);
    label("Positionals", "Arguments");
    for (const char* number : {"INT", "UINT", "FLOAT"}) label(number, "N");
  }
  std::string make_usage(const CLI::App* app, std::string name) const override {
    return "\n" + CLI::Formatter::make_usage(app, name);
  }
  /// Groups are one blank line apart.
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override {
    std::string help = CLI::Formatter::make_help(app, name, mode);
    for (std::size_t at; (at = help.find("\n\n\n")) != std::string::npos;) help.erase(at, 1);
    return help.erase(help.find_last_not_of('\n') + 1) + "\n";
  }
  /// Descriptions that are long go on below themselves.
  std::string make_option(const CLI::Option* option, bool is_positional) const override {
    constexpr std::size_t kTextWidth = 120;
    const std::size_t indent = get_column_width();
    std::string out = "  " + make_option_name(option, is_positional) + make_option_opts(option), line;
    out += out.size() < indent ? std::string(indent - out.size(), ' ') : "\n" + std::string(indent, ' ');
    std::istringstream words(make_option_desc(option));
    for (std::string word; words >> word;) {
      if (!line.empty() && indent + line.size() + word.size() >= kTextWidth) {
        out += line + "\n" + std::string(indent, ' ');
        line.clear();
      }
      line += (line.empty() ? "" : " ") + word;
    }
    return out + line + "\n";
  }
  std::string make_option_opts(const CLI::Option* option) const override {
    if (!option->get_option_text().empty()) return " " + option->get_option_text();
    if (option->get_type_size() == 0) return "";
    const bool many = option->get_expected_max() == CLI::detail::expected_max_vector_size;
    const std::string value = option->get_positional() ? "" : " " + get_label(option->get_type_name());
    return value + (many ? " ..." : "") + (option->get_required() ? " (required)" : "");
  }
};

const char* const kFileExtensions[] = {".avi", ".csv",         ".exr", ".gif",   ".glb",  ".html", ".jpeg",
                                       ".jpg", ".json",        ".mov", ".obj",   ".mp4",  ".npz",  ".ply",
                                       ".png", ".safetensors", ".spz", ".splat", ".webm", ".zip"};

bool is_file_name(const fs::path& path) {
  const std::string extension = lower_case(path.extension().string());
  return std::find(std::begin(kFileExtensions), std::end(kFileExtensions), extension) != std::end(kFileExtensions);
}

std::string problem_of_place(const std::string& given, const char* wanted) {
  if (given == "-") return text("-: nothing is written to standard output; name ", wanted);
  const fs::path file = file_in_the_way(fs::path(given).parent_path());
  return file.empty() ? "" : text(given, ": ", file.string(), " is a file, not a folder; choose another path");
}

std::string problem_of_folder(const std::string& given) {
  std::error_code ignored;
  if (const std::string problem = problem_of_place(given, "a folder"); !problem.empty()) return problem;
  if (fs::is_directory(given, ignored)) return "";
  if (fs::exists(given, ignored)) return given + " is a file; name a folder";
  if (!is_file_name(given)) return "";
  return text(given, " is a file name, but several files are written; name a folder for them, such as ",
              fs::path(given).replace_extension().string());
}

std::string problem_of_file(const std::string& given) {
  std::error_code ignored;
  if (const std::string problem = problem_of_place(given, "a file"); !problem.empty()) return problem;
  if (fs::is_other(given, ignored)) return given + " is a device or a pipe; name a file";
  return fs::is_directory(given, ignored) ? given + " is a folder; name a file" : "";
}

}  // namespace

Option Option::required() const { return Option(option_->required()); }
Option Option::expected(int words) const { return Option(option_->expected(words)); }
Option Option::one_word() const { return Option(option_->allow_extra_args(false)); }
Option Option::shown_as(const char* word) const { return Option(option_->type_name(word)); }

Option Option::offers(const std::vector<std::string>& words) const {
  cloam::offers()[option_] = words;
  return *this;
}

std::vector<std::string> offered(const CLI::Option& option) {
  const auto found = offers().find(&option);
  return found == offers().end() ? std::vector<std::string>() : found->second;
}

template <class Value>
Option Options::operator()(const std::string& name, Value& value, const std::string& help, const Check& check) const {
  CLI::Option* option = nullptr;
  if constexpr (std::is_same_v<Value, bool>)
    option = parser.add_flag(name, value, help);
  else
    option = parser.add_option(name, value, help);
  if (check && !check->words.empty()) offers()[option] = check->words;
  if (check) option->transform(check->validator);  // before CLI11 reads the value: a duration becomes seconds
  return Option(option);
}

using Words = std::vector<std::string>;
template Option Options::operator()(const std::string&, bool&, const std::string&, const Check&) const;
template Option Options::operator()(const std::string&, int&, const std::string&, const Check&) const;
template Option Options::operator()(const std::string&, int64_t&, const std::string&, const Check&) const;
template Option Options::operator()(const std::string&, uint64_t&, const std::string&, const Check&) const;
template Option Options::operator()(const std::string&, float&, const std::string&, const Check&) const;
template Option Options::operator()(const std::string&, double&, const std::string&, const Check&) const;
template Option Options::operator()(const std::string&, std::string&, const std::string&, const Check&) const;
template Option Options::operator()(const std::string&, Words&, const std::string&, const Check&) const;
template Option Options::operator()(const std::string&, std::optional<int>&, const std::string&, const Check&) const;
template Option Options::operator()(const std::string&, std::optional<int64_t>&, const std::string&,
                                    const Check&) const;
template Option Options::operator()(const std::string&, std::optional<double>&, const std::string&, const Check&) const;

void Options::with_or_without(const std::string& name, const char* word, const std::string& help,
                              const std::function<void(const std::string&)>& typed) const {
  const auto take = [typed](const CLI::results_t& words) {
    const std::string given = words.empty() ? "" : words.front();
    typed(given == "{}" || given == "true" ? "" : given);  // what CLI11 has for none
    return true;
  };
  parser.add_option(name, take, help)->expected(0, 1)->option_text(word);
}

void Options::flag_or_word(const std::string& name, const std::string& alone, std::string& value,
                           const std::string& help, const Check& check) const {
  parser.add_flag(name + "{" + alone + "}", value, help)->transform(check->validator);
}

void Options::group(const char* heading) const { parser.option_defaults()->group(heading); }

CLI::App* add_parser(CLI::App& program, const char* name, const char* examples) {
  return program.add_subcommand(name, examples);
}

void add_common(CLI::App& parser, Common& common) {
  const Options add{parser};
  add.group("Device and output");
  parser.set_help_flag("-h,--help", "Print this help message and exit");  // here rather than in a group of its own
  add("--device", common.device, "auto, cpu, gpu, N, P:D or part of a name (cloam info lists them)");
  add("--max-memory", common.max_memory, "Limit of device memory, such as 600M or 6G");
  add("--json", common.json, "Machine-readable output on stdout");
  add("-q,--quiet", common.quiet, "Print only errors and warnings");
  add("-v,--verbose", common.verbose, "Print more detail");
  add("--require-gpu", common.require_gpu, "End with an error (exit 4) rather than run on a CPU");
  add("--force", common.force, "Use the device even if selftest found that its results are wrong");
  add("--profile", common.profile, "At the end, print the cost of each kernel and each step");
  add("--profile-trace", common.profile_trace, "Also write a timeline for Perfetto to this file", output_file());
  // Of the commands' own -o those of export and report may be files; export knows more of it.
  const std::string command = parser.get_name();
  if (CLI::Option* out = parser.get_option_no_throw("--out"))
    out->check((command == "export"   ? output_path()
                : command == "report" ? output_file()
                                      : output_folder())
                   ->validator);
}

void add_allow_outside(const Options& add, bool& allowed) {
  add("--allow-outside", allowed,
      "Also read images and points outside the capture's folder, if the capture lists them");
}

Check whole_number(int64_t least, int64_t most) {
  return check([=](std::string& word) {
    int64_t value = 0;
    if (read_whole(word, value) && value >= least && value <= most) return std::string();
    return text(word, ": want a whole number ", range_words(least, most));
  });
}

Check number_from(double least, double most) {
  return check([=](std::string& word) {
    double value = 0;
    if (read_whole(word, value) && value >= least && value <= most) return std::string();
    return text(word, ": want a number from ", least, " to ", most);
  });
}

Check duration() {
  return check([](std::string& word) -> std::string {
    try {
      word = text(parse_duration(word));
      return "";
    } catch (const Error& error) { return error.what(); }
  });
}

Check one_of(const std::vector<std::string>& words) {
  const auto wrong = [=](std::string& word) {
    if (std::find(words.begin(), words.end(), word) != words.end()) return std::string();
    return text(word, ": want ", either(words), did_you_mean(word, words));
  };
  return std::make_shared<WordCheck>(WordCheck{CLI::Validator(wrong, ""), words});
}

Check output_folder() { return check(problem_of_folder); }
Check output_file() { return check(problem_of_file); }
Check output_path() {
  return check([](const std::string& given) { return problem_of_place(given, "a file or folder"); });
}

std::string problem_of(const Check& check, std::string word) { return check->validator(word); }

fs::path with_format(const fs::path& path, const std::string& format) {
  const std::string extension = "." + format;
  if (format.empty() || lower_case(path.filename().string()).ends_with(extension)) return path;
  if (!is_file_name(path)) return path.string() + extension;
  throw Error(Fault::usage,
              text("--format ", format, " contradicts -o ", path.string(), ": leave out --format, or name the file ",
                   fs::path(path).replace_extension(extension).string()));
}

std::shared_ptr<CLI::Formatter> help_format() { return std::make_shared<HelpFormat>(); }

std::string complaint(const CLI::ParseError& error, const CLI::App& program) {
  std::string said = error.what();
  if (program.get_subcommands().empty()) return said;
  const CLI::App& command = *program.get_subcommands().front();
  const std::string name = said.substr(0, said.find_first_of(": "));
  if (dynamic_cast<const CLI::ValidationError*>(&error)) {  // "--steps: ten: want ..."
    const std::size_t colon = said.find(": ");
    return colon == std::string::npos ? said : said.erase(colon, 1);
  }
  if (dynamic_cast<const CLI::RequiredError*>(&error))
    return missing(command, name, "cloam " + command.get_name() + " needs");
  if (dynamic_cast<const CLI::ArgumentMismatch*>(&error)) {
    const CLI::Option* option = command.get_option_no_throw(name);
    if (option && option->count() > 1) return name + " is given more than once" + help_of(command);
    return missing(command, name, "a value is missing for");
  }
  if (dynamic_cast<const CLI::ConversionError*>(&error)) {  // "Could not convert: --seed = 1e99"
    const std::size_t colon = said.find(": "), equals = said.find(" = ");
    if (colon != std::string::npos && equals != std::string::npos && equals > colon)
      return said.substr(colon + 2, equals - colon - 2) + " " + said.substr(equals + 3) +
             ": not a number that this option can take" + help_of(command);
  }
  return said + help_of(command);
}

}  // namespace cloam
