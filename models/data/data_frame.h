// Tables with named columns, as pandas pickles them: the form of PandaSet's LiDAR sweeps and cuboids.
#pragma once
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace cloam {

/// Truth values, whole numbers, numbers or texts; monostate for what we do not read (dates, categories).
using ColumnValues = std::variant<std::monostate, std::vector<std::uint8_t>, std::vector<std::int64_t>,
                                  std::vector<double>, std::vector<std::string>>;

struct Column {
  std::string name;
  ColumnValues values;
};

class DataFrame {
 public:
  explicit DataFrame(std::string file = "") : file_(std::move(file)) {}

  std::size_t rows() const { return rows_; }
  const std::vector<Column>& columns() const { return columns_; }
  bool has(std::string_view name) const { return find(name) != nullptr; }

  /// Fault::data for a column of another length than those before, or a name that is taken.
  void add(Column column);

  /// Fault::data where the column is missing or holds something else; whole numbers and truth values are numbers too.
  std::vector<double> numbers(std::string_view name) const;
  const std::vector<std::string>& texts(std::string_view name) const;

 private:
  const Column* find(std::string_view name) const;
  const Column& column(std::string_view name) const;

  std::string file_;  // for errors
  std::size_t rows_ = 0;
  std::vector<Column> columns_;
};

/// Reads a pickled data frame, gzip'd or plain, of any pandas from 0.20 to 2 and protocols 2 to 5. Nothing in the file
/// is run (pickle.h). Fault::data with the byte offset for all else.
DataFrame read_data_frame(const std::filesystem::path& path);
DataFrame parse_data_frame(std::span<const std::uint8_t> pickle, const std::string& name);

/// As PandaSet's files are: protocol 4 in the form of pandas before 1.3, which every later pandas reads, gzip'd.
/// Written through commit_bytes; equal frames give equal bytes.
void write_data_frame(const std::filesystem::path& path, const DataFrame& frame);
std::vector<std::uint8_t> pickle_data_frame(const DataFrame& frame);

}  // namespace cloam
