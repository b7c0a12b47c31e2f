// Zip files byte by byte, for tests of what reads them.
#pragma once
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "models/io/gzip.h"

namespace cloam {

using Bytes = std::vector<std::uint8_t>;

inline void put(const std::filesystem::path& path, const Bytes& bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

inline void add(Bytes& to, std::uint64_t value, int size) {
  for (int i = 0; i < size; i++) to.push_back(static_cast<std::uint8_t>(value >> 8 * i));
}
inline void add(Bytes& to, const Bytes& more) { to.insert(to.end(), more.begin(), more.end()); }
inline void add(Bytes& to, const std::string& more) { to.insert(to.end(), more.begin(), more.end()); }

struct Member {
  std::string name;
  Bytes content;
  bool deflated = false;
  std::uint32_t claimed = 0;  // another size than the true one, in the directory
};

/// A zip as numpy makes it: sizes of local headers are those of zip64, so that only the directory can be believed.
inline Bytes zip_bytes(const std::vector<Member>& members) {
  Bytes all, directory;
  for (const Member& m : members) {
    const Bytes packed = gzip(m.content);  // 10 bytes of header, deflate, checksum and size
    const Bytes raw = m.deflated ? Bytes(packed.begin() + 10, packed.end() - 8) : m.content;
    std::uint32_t checksum = 0;
    std::memcpy(&checksum, packed.data() + packed.size() - 8, 4);
    const auto offset = all.size();
    Bytes common;
    add(common, 20, 2), add(common, 0, 2), add(common, m.deflated ? 8 : 0, 2), add(common, 0, 4),
        add(common, checksum, 4);
    add(all, 0x04034b50, 4), add(all, common), add(all, 0xffffffffffffffff, 8), add(all, m.name.size(), 2);
    add(all, 4, 2), add(all, m.name), add(all, 1, 4), add(all, raw);
    add(directory, 0x02014b50, 4), add(directory, 20, 2), add(directory, common), add(directory, raw.size(), 4);
    add(directory, m.claimed ? m.claimed : m.content.size(), 4), add(directory, m.name.size(), 2),
        add(directory, 0, 12);
    add(directory, offset, 4), add(directory, m.name);
  }
  const auto offset = all.size();
  add(all, directory), add(all, 0x06054b50, 4), add(all, 0, 4);
  add(all, members.size(), 2), add(all, members.size(), 2), add(all, directory.size(), 4), add(all, offset, 4),
      add(all, 0, 2);
  return all;
}

}  // namespace cloam
