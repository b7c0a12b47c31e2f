// See train_prior.h.
#include "cli/train_prior.h"

#include "models/io/crc32c.h"
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

void adopt_prior(TrainJob& job, const TrainRequest& request) {
  if (!job.record.prior) return;
  const fs::path folder = find_prior(job, request);
  if (!learned_from_run(read_record(folder)))
    throw Error(Fault::usage, text("--prior ", folder.string(), " is a run of ", read_record(folder).method,
                                   ", want a diffusion run\n  fix: cloam train diffusion ",
                                   cloam::quoted(job.record.networks->given), " makes one"));
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
  job.prior = restore_run(std::move(stored)).method;
  require<TakesPrior>(*job.method, job.record.method, "--prior")
      .adopt_prior(as<GeneratesAssets>(*job.prior)->denoiser());
}

}  // namespace cloam
