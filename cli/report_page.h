// One page on a run: one HTML file that holds its pictures and needs nothing else.
#pragma once
#include <filesystem>
#include <string>

namespace cloam {

/// Writes the page from what lies in the run folder: computes and renders nothing. Fault::usage and Fault::data as
/// read_record; Fault::data for a damaged log, evaluation or picture; Fault::write.
void write_report_page(const std::filesystem::path& run, const std::filesystem::path& page);

/// The picture that shows most of a run: the newest preview, else the sheet of assets, else the first of an evaluation;
/// empty if there is none.
std::filesystem::path main_picture(const std::filesystem::path& run);

}  // namespace cloam
