// The ranks that mpirun started this program as: found, given their cores and devices, and brought to an end together.
#pragma once
#include <string>
#include <vector>

#include "cli/common.h"
#include "models/train/ranks.h"

namespace cloam {

/// Takes part if the program was started as one of several, before the first OpenCL call: ranks of one host that may
/// use the same cores split them. Only the first speaks from here on (mute). Fault::usage where the program was built
/// without MPI.
void join_ranks();
/// alone() unless several were joined.
const Ranks& ranks();
/// "rank 1 of 4: ", for messages; "" for one that is alone.
std::string rank_words();
/// Fault::usage for a command that several ranks cannot share.
void check_can_share(const std::string& command);

/// Where CLOAM_DEVICE says nothing, it becomes one of the host's GPUs of one kind, which its ranks take in turn.
void take_gpu_in_turn();
/// --devices: of "0:0,0:1" in turn for the ranks of a host. Fault::usage for a list without ranks.
void choose_rank_device(const std::string& devices, Common& common);
/// Fault::device unless all ranks have devices of one kind, which alone gives them the same bits.
void check_devices_alike();

/// Variables for a program that a rank starts, which is none itself; of one that is alone, none.
std::vector<std::string> environment_of_no_rank();

/// Before the program ends well: waits for the others.
void leave_ranks();
/// Before the last message of a failure or stop: where all end alike, the first rank is given the time to tell it for
/// them.
void await_first_rank();
/// After it: ends all ranks.
void end_ranks(int code);

}  // namespace cloam
