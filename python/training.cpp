// A training, one step at a time, in a run folder as `cloam train` makes it.
#include "models/runs/training.h"

#include <mutex>

#include "models/io/commit.h"
#include "models/io/words.h"
#include "models/runs/settings.h"
#include "models/runs/version.h"
#include "python/bindings.h"
#include "runtime/error.h"

namespace cloam {
namespace {

/// A job from its request to the end of its record.
class Session {
 public:
  explicit Session(const TrainRequest& request) : request_(request) { begin(); }
  ~Session() { close(); }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  /// None at the end.
  std::optional<StepReport> step();
  void save();
  /// Saves what was not and writes how the training ended: of its own, or because Ctrl-C came. Nothing is left to do
  /// afterwards.
  TrainResult end(bool interrupted = false);
  /// The same where nobody waits for what goes wrong.
  void close() noexcept;
  const TrainJob& job() const { return job_; }

 private:
  void begin();
  template <class Work>
  auto recorded(const Work& work);

  TrainRequest request_;
  TrainJob job_;
  std::optional<FolderLock> folder_;
  std::optional<LoadedCheckpoint> checkpoint_;
  std::unique_ptr<Training> training_;  // none: it ended
  std::optional<StepReport> last_;
  int64_t saved_ = 0;
  TrainResult result_;
  std::mutex busy_;
};

/// Whatever goes wrong is recorded, and ends the training.
template <class Work>
auto Session::recorded(const Work& work) {
  try {
    return work();
  } catch (const Error& error) {
    training_.reset();
    try {
      end_failed_record(job_);
    } catch (const Error&) {  // the disk may be the trouble; what is told is the first error
    }
    folder_.reset();
    throw Error(error.fault(), error.what() + way_on(job_, error.fault(), saved_));
  }
}

void Session::begin() {
  job_ = request_.resume ? resumed_job(request_) : new_job(request_, python_listener());
  if (job_.finished)
    throw Error(Fault::usage, text(job_.folder.string(), " is finished (", job_.record.step,
                                   " steps)\n  fix: resume it with more steps to train further"));
  open_device();
  const uint64_t host_bytes = default_host_budget();
  const auto told = [](const std::string&, std::size_t, std::size_t) {};
  TrainingInput input = read_input(job_, request_, host_bytes, told);
  for (const Capture& capture : input.captures)
    for (const std::string& warning : capture.warnings) python_warning(warning);
  check_memory(plan_memory(job_, sizes_of(input.captures), host_bytes), job_, input.captures);
  check_interrupt();
  Scenes scenes = job_.source ? std::move(job_.source->scenes) : Scenes();
  job_.source.reset();
  if (Scenes given = give_data(job_, std::move(input.captures), [](std::size_t, std::size_t) {}); !given.empty())
    scenes = std::move(given);
  folder_.emplace(job_.folder);
  if (!request_.resume) check_folder(job_.folder, request_.overwrite);
  if (request_.resume) checkpoint_ = checkpoint_to_go_on(job_, python_warning);
  take_progress(job_, checkpoint_, request_);
  saved_ = job_.record.step;
  begin_record(job_, input.now, request_.overwrite, text("cloam.Training of Python: ", job_.record.method));
  recorded([&] {
    write_settings(job_, scenes);
    TrainRun run{*job_.method, RunPaths{job_.folder}.checkpoints(), checkpoint_metadata(job_.record)};
    run.resume = checkpoint_ ? &checkpoint_->file : nullptr;
    TrainListener listener;
    listener.step = [this](const StepReport& report) {
      job_.record.step = report.progress.step;
      last_ = report;
    };
    listener.checkpoint = [this](int64_t step, const std::filesystem::path&) { saved_ = step; };
    listener.warning = python_warning;
    training_ = std::make_unique<Training>(run, options_of(job_, request_), listener);
  });
}

std::optional<StepReport> Session::step() {
  const std::scoped_lock lock(busy_);
  if (!training_) return std::nullopt;
  return recorded([&] { return training_->step() ? last_ : std::nullopt; });
}

void Session::save() {
  const std::scoped_lock lock(busy_);
  if (training_) recorded([&] { training_->save(); });
}

TrainResult Session::end(bool interrupted) {
  const std::scoped_lock lock(busy_);
  if (!training_) return result_;
  return recorded([&] {
    training_->save();
    result_ = training_->result();
    result_.interrupted = interrupted;
    training_.reset();
    end_record(job_, result_);
    folder_.reset();
    return result_;
  });
}

void Session::close() noexcept {
  try {
    end();
  } catch (const std::exception&) {  // recorded; the last checkpoint is whole
  }
}

py::dict words_of(const StepReport& report) {
  py::dict out;
  out["step"] = report.progress.step;
  out["of"] = report.end;
  out["loss"] = report.loss;
  out["learning_rate"] = report.rate;
  out["seconds"] = report.step_seconds;
  for (const auto& [name, value] : report.metrics) out[py::str(name)] = value;
  return out;
}

/// A value as --set takes it.
std::string setting_word(const py::handle& value) {
  if (py::isinstance<py::bool_>(value)) return value.cast<bool>() ? "true" : "false";
  return py::str(value);
}

template <class Value>
void take(const py::dict& options, const char* name, Value& into) {
  if (!options.contains(name)) return;
  const py::object value = options[name];
  options.attr("pop")(name);
  if constexpr (std::is_same_v<Value, std::string>)
    into = py::str(value);
  else
    into = option_as<Value>(name, value);
}

void take_settings(const py::dict& options, TrainRequest& request) {
  if (!options.contains("settings")) return;
  if (!py::isinstance<py::dict>(options["settings"]))
    throw Error(Fault::usage, "settings are a dict, such as {\"train.rate\": 0.01}");
  for (const auto& [key, value] : options["settings"].cast<py::dict>())
    request.settings.push_back(std::string(py::str(key)) + "=" + setting_word(value));
  options.attr("pop")("settings");
}

/// Options under the names of `cloam train`, with _ for -.
TrainRequest request_from(const py::dict& given) {
  const py::dict options = given.attr("copy")();
  TrainRequest r;
  take_settings(options, r);
  take(options, "out", r.out);
  take(options, "preset", r.preset);
  take(options, "config", r.config_file);
  take(options, "networks", r.networks);
  take(options, "prior", r.prior);
  take(options, "precision", r.precision);
  take(options, "steps", r.steps);
  take(options, "time_budget", r.time_budget);
  take(options, "stop_after", r.stop_after);
  take(options, "save_every", r.save_every);
  take(options, "seed", r.seed);
  take(options, "gradient_accumulation", r.accumulation);
  take(options, "overwrite", r.overwrite);
  take(options, "downscale", r.downscale);
  take(options, "holdout", r.holdout);
  take(options, "protocol", r.protocol);
  take(options, "sparse_every", r.sparse_every);
  take(options, "image", r.image);
  take(options, "masks", r.masks);
  take(options, "actors", r.actors);
  take(options, "skip_bad", r.skip_bad);
  if (options.size() > 0)
    throw Error(Fault::usage, text("cloam.Training takes no ", std::string(py::str((*options.begin()).first)),
                                   "\n  fix: help(cloam.Training) lists what it takes"));
  return r;
}

Owned<Session> begun(const TrainRequest& request) {
  const Unlocked others;
  return Owned<Session>(new Session(request));
}

Owned<Session> new_session(const std::string& method, const py::object& data, const py::kwargs& options) {
  TrainRequest request = request_from(options);
  request.method = method;
  if (py::isinstance<py::list>(data) || py::isinstance<py::tuple>(data))
    for (const py::handle one : data) request.data.push_back(py::str(one));
  else
    request.data.push_back(py::str(data));
  return begun(request);
}

Owned<Session> resumed_session(const std::filesystem::path& run, const py::kwargs& options) {
  TrainRequest request = request_from(options);
  request.resume = true;
  request.out = run.string();
  return begun(request);
}

/// The next step's report, or StopIteration.
py::dict next_step(Session& session) {
  std::optional<StepReport> report;
  {
    const Unlocked others;
    report = session.step();
  }
  if (!report) throw py::stop_iteration();
  return words_of(*report);
}

constexpr char kTraining[] =
    R"(A training in a run folder, one step at a time: the checkpoints are those of `cloam train`, byte for byte.

    with cloam.Training("nerf", "data/fox", out="runs/fox", steps=1000, downscale=4) as training:
        for report in training:
            print(report["step"], report["loss"])

Takes the options of `cloam train` by name, with _ for -: out, preset, config, settings (a dict, as --set), networks,
prior, precision, steps, time_budget (seconds, from now on), stop_after, save_every, seed, gradient_accumulation, overwrite, downscale,
holdout, protocol, sparse_every, image, masks, actors, skip_bad. data: a folder, or several of driving logs. Images are
read and the model is built here. At the end of `with`, or by end(), what was not saved is, and the record is closed;
Ctrl-C between two steps leaves a run that `cloam train --resume` and resume() go on with.)";

}  // namespace

void add_training(py::module_& module) {
  py::class_<Session, Owned<Session>>(module, "Training", kTraining)
      .def(py::init(&new_session), py::arg("method"), py::arg("data"))
      .def_static("resume", &resumed_session, py::arg("run"),
                  "Goes on with a run that was interrupted or stopped; steps=N extends one that is finished.")
      .def(
          "step",
          [](Session& session) -> py::object {
            std::optional<StepReport> report;
            {
              const Unlocked others;
              report = session.step();
            }
            return report ? py::object(words_of(*report)) : py::none();
          },
          "Makes the next step and tells of it: step, of, loss, learning_rate, seconds and the method's figures. None "
          "at the end.")
      .def("__iter__", [](py::object self) { return self; })
      .def("__next__", &next_step)
      .def("save", &Session::save, py::call_guard<Unlocked>(), "Saves a checkpoint now.")
      .def(
          "end",
          [](Session& session) {
            TrainResult result;
            {
              const Unlocked others;
              result = session.end();
            }
            return result.checkpoint;
          },
          "Saves what was not, and closes the record; gives the last checkpoint.")
      .def("__enter__", [](py::object self) { return self; })
      .def("__exit__",
           [](Session& session, const py::object& type, const py::object&, const py::object&) {
             const bool interrupted =
                 !type.is_none() && PyErr_GivenExceptionMatches(type.ptr(), PyExc_KeyboardInterrupt);
             const Unlocked others;
             session.end(interrupted);
           })
      .def_property_readonly("folder", [](const Session& session) { return session.job().folder; })
      .def_property_readonly("settings", [](const Session& session) { return session.job().record.settings; });
}

}  // namespace cloam
