// See training_sources.h.
#include "models/runs/training_sources.h"

#include <algorithm>

#include "models/io/crc32c.h"
#include "models/io/words.h"
#include "models/latents/generates_assets.h"
#include "models/latents/takes_prior.h"
#include "models/train/shares_networks.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;

uint32_t checksum_of_networks(const StoredRun& run) {
  uint32_t sum = 0;
  for (const auto& [name, tensor] : networks_in(parameters_in(run.checkpoint.file))) sum = crc32c(tensor.data, sum);
  return sum;
}

/// Codes mean something to the networks that they were learned with, and to no others.
void check_learned_from(const StoredRun& prior, const fs::path& networks) {
  const StoredRun given = read_run(networks);
  if (prior.record.data.front().fingerprint == fingerprint(given)) return;
  const StoredRun source = read_source(prior);
  if (checksum_of_networks(source) == checksum_of_networks(given)) return;
  throw Error(Fault::usage,
              text("--prior ", prior.folder.string(), " learned from ", source.folder.string(),
                   ", whose networks are not those of ", networks.string(), "\n  fix: --networks ",
                   quoted(source.folder.string()), ", or: cloam train diffusion ", quoted(networks.string())));
}

/// Where the prior of a run that goes on lies now.
fs::path find_prior(const TrainJob& job, const TrainRequest& request) {
  if (!request.resume || !request.prior.empty()) return job.record.prior->given;
  try {
    return find_data(job.folder, *job.record.prior);
  } catch (const Error&) {
    throw Error(Fault::data, text("the prior of ", job.folder.string(), " is missing; looked for ",
                                  job.record.prior->relative, " from there and ", job.record.prior->given,
                                  "\n  fix: name its new location: cloam train --resume ", quoted(job.folder.string()),
                                  " --prior RUN"));
  }
}

}  // namespace

std::vector<DataNow> data_now(const TrainJob& job, const Captures& captures) {
  if (job.source) return {{job.source->folder, fingerprint(*job.source)}};
  std::vector<DataNow> all;
  for (const Capture& capture : captures) all.push_back({capture.scene.place(), fingerprint(capture.scene)});
  return all;
}

void check_data_unchanged(const TrainJob& job, const std::vector<DataNow>& data) {
  for (std::size_t i = 0; i < data.size(); ++i)
    check_same_data(job.data[i], job.record.data[i], data[i].fingerprint,
                    text("; to train on other data, start another run: cloam train ", job.record.method, " ",
                         quoted(job.data[i].string()), " -o RUN"));
}

void note_places(TrainJob& job, const std::vector<DataNow>& data) {
  std::error_code error;
  for (std::size_t i = 0; i < data.size(); ++i) {
    job.record.data[i].fingerprint = data[i].fingerprint;
    job.record.data[i].relative = relative_to_run(fs::weakly_canonical(data[i].root, error), job.folder);
  }
}

void note_recordings(TrainJob& job, const Captures& captures) {
  std::vector<Recording>& recordings = job.record.reading.recordings;
  recordings.clear();
  for (const Capture& capture : captures) recordings.push_back(capture.scene.recording);
  const bool plain =
      std::all_of(recordings.begin(), recordings.end(), [](const Recording& r) { return r == Recording{}; });
  if (plain) recordings.clear();
}

void adopt_networks(TrainJob& job, const TrainRequest& request) {
  if (!job.record.networks) return;
  std::error_code error;
  const bool own = request.resume && has_checkpoints(RunPaths{job.folder}.checkpoints());
  fs::path source = own ? job.folder : fs::path(job.record.networks->given);
  if (request.resume && !own) source = find_data(job.folder, *job.record.networks);
  require<SharesNetworks>(*job.method, job.record.method, "--networks")
      .adopt_networks(parameters_in(load_latest_checkpoint(RunPaths{source}.checkpoints()).file));
  if (!own) job.record.networks->relative = relative_to_run(fs::weakly_canonical(source, error), job.folder);
}

void adopt_prior(TrainJob& job, const TrainRequest& request) {
  if (!job.record.prior) return;
  const fs::path folder = find_prior(job, request);
  if (!learned_from_run(read_record(folder)))
    throw Error(Fault::usage, text("--prior ", folder.string(), " is a run of ", read_record(folder).method,
                                   ", want a diffusion run\n  fix: cloam train diffusion ",
                                   quoted(job.record.networks->given), " makes one"));
  StoredRun stored = read_run(folder);
  const std::string now = fingerprint(stored);
  std::string& then = job.record.prior->fingerprint;
  if (!request.resume) check_learned_from(stored, job.record.networks->given);
  if (!then.empty() && then != now)
    throw Error(Fault::data, text(folder.string(), " is not the prior that ", job.folder.string(), " started with (",
                                  then, "; now ", now, ")\n  fix: restore that run, or train again"));
  then = now;
  std::error_code error;
  job.record.prior->relative = relative_to_run(fs::weakly_canonical(folder, error), job.folder);
  std::optional<StoredRun> source;
  if (const auto start = job.record.settings.find("prior.start");
      start != job.record.settings.end() && start->second != "diffusion")
    source = read_source(stored);
  job.prior = restore_run(std::move(stored)).method;
  if (source) as<LearnsFromRun>(*job.prior)->load(source_of(*source));
  require<TakesPrior>(*job.method, job.record.method, "--prior")
      .adopt_prior(as<GeneratesAssets>(*job.prior)->denoiser());
}

}  // namespace cloam
