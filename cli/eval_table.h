// What an evaluation found, as tables for people.
#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "models/eval/report.h"

namespace cloam {

std::string table(const EvalResult& result);
/// Of a run of diffusion.
std::string prior_table(const nlohmann::ordered_json& figures);

}  // namespace cloam
