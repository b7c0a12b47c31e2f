// See asset_files.h. What is kept of an asset once it is written is its code and its row in the record.
#include "models/eval/asset_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "models/eval/pictures.h"
#include "models/io/commit.h"
#include "models/io/gif.h"
#include "models/latents/shows_assets.h"
#include "models/mesh/write_mesh.h"
#include "models/runs/actor_names.h"
#include "models/runs/shared_work.h"
#include "models/scene/asset_class.h"
#include "models/street/asset_mesh.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Report = nlohmann::ordered_json;

constexpr int kFramesPerSecond = 12;
constexpr std::size_t kMostOfGrid = 256;  // a sheet that people look at
constexpr char kPictures[] = "pictures", kGrid[] = "grid.png", kLatents[] = "latents.safetensors",
               kRecord[] = "generate.json";

const char* time_of_day(bool night) { return night ? "night" : "day"; }

/// Nothing of when, where and by whom: equal runs and seeds give equal bytes.
Report how_made(const RestoredRun& prior, const StoredRun& source, const AssetRequest& wish, const MadeBy& by) {
  return {{"version", by.version},
          {"seed", wish.seed},
          {"guidance", wish.guidance},
          {"steps", wish.steps},
          {"codes", by.codes},
          {"class", wish.asset_class ? kAssetClasses[*wish.asset_class] : "as in training"},
          {"time", wish.night ? time_of_day(*wish.night) : "as in training"},
          {"prior", fingerprint(prior)},
          {"prior_settings", prior.record.settings},
          {"decoder", fingerprint(source)},
          {"decoder_settings", source.record.settings}};
}

Report described(const NewAsset& asset, std::size_t number) {
  return {{"asset", number},
          {"class", kAssetClasses[asset.asset_class]},
          {"time", time_of_day(asset.night)},
          {"size_m", {asset.size.x(), asset.size.y(), asset.size.z()}}};
}

/// Writes what there is of each asset, and keeps what is written of all: latents, the sheet and the record.
class AssetWriter {
 public:
  AssetWriter(const Generation& made, const AssetFiles& files, const Listener& listener)
      : made_(made), files_(files), listener_(listener), latents_(made.code_shape()) {}

  /// Of the assets of now, which ranks share.
  void write_part(const Ranks& ranks) {
    const auto make = [&](std::size_t item) { return write(made_.assets()[item], made_.names()[item], first_ + item); };
    const auto complete = [&](std::size_t done) {
      return text(first_ + done, " of ", made_.wished(), " assets are complete in ", files_.folder.string(),
                  ", without ", kGrid, ", ", kLatents, " and ", kRecord);
    };
    const std::vector<NewAsset>& assets = made_.assets();
    std::vector<Report> parts = share_out(ranks, listener_, {assets.size(), make, complete});
    for (std::size_t i = 0; i < assets.size(); ++i) keep(assets[i], std::move(parts[i]));
    first_ += assets.size();
  }

  /// The record.
  Report all() const { return {{"schema_version", 1}, {"made", made_.how()}, {"assets", rows_}}; }

  void write_rest() {
    const int columns = static_cast<int>(std::ceil(std::sqrt(static_cast<double>(grid_.size()))));
    write_png(files_.grid(), contact_sheet(grid_, columns, captions_), made_.how().dump());
    std::map<std::string, std::string> words;
    for (const auto& [key, value] : made_.how().items())
      words[key] = value.is_string() ? value.get<std::string>() : value.dump();
    latents_.write(files_.folder / kLatents, words);
    commit_text(files_.folder / kRecord, all().dump(2) + "\n");
  }

 private:
  /// The files of one asset. Returns its row in the record, and its picture for the sheet.
  Report write(const NewAsset& asset, const AssetName& name, std::size_t number) {
    Report row = described(asset, number);
    write_turntable(asset, name, row);
    if (files_.meshes) write_mesh(asset, name, row);
    const Image picture =
        number < kMostOfGrid ? three_quarter_picture(made_.street(), name, asset.size, files_.size) : Image();
    listener_.say(text("generate ", number + 1, "/", made_.wished(), "  ", kAssetClasses[asset.asset_class], ", ",
                       time_of_day(asset.night)));
    return {{"row", row}, {"picture", packed(picture.pixels)}};
  }

  void keep(const NewAsset& asset, Report part) {
    Report& row = part.at("row");
    if (files_.meshes && !row.contains("mesh"))
      listener_.warn(text("asset ", number_of(row), " has no surface in its box: no mesh is written"));
    if (number_of(row) < kMostOfGrid) {
      captions_.push_back({text(grid_.size(), "  ", kAssetClasses[asset.asset_class]), time_of_day(asset.night)});
      grid_.push_back({files_.size, files_.size, 3, unpacked<std::uint8_t>(part.at("picture"))});
    }
    latents_.add(asset);
    rows_.push_back(std::move(row));
  }

  fs::path file_of(const Report& row, const char* extension) const {
    return files_.folder / fmt::format("asset_{:03}.{}", number_of(row), extension);
  }
  static std::size_t number_of(const Report& row) { return row.at("asset").get<std::size_t>(); }

  void write_turntable(const NewAsset& asset, const AssetName& name, Report& row) {
    const std::vector<Image> turn = turntable(made_.street(), name, asset.size, files_.frames, files_.size);
    const fs::path gif = file_of(row, "gif");
    Report how = row;
    how.update(made_.how());
    write_gif(gif, turn, kFramesPerSecond, how.dump());
    row["turntable"] = gif.filename().string();
    // For `distance`, which wants no loops but pictures.
    for (std::size_t i = 0; files_.pictures && i < turn.size(); ++i)
      write_png(files_.folder / kPictures / fmt::format("asset_{:03}_{:04}.png", number_of(row), i), turn[i]);
  }

  /// The mesh's file, or none where the asset has no surface.
  void write_mesh(const NewAsset& asset, const AssetName& name, Report& row) {
    const fs::path path = file_of(row, "glb");
    const Mesh mesh = asset_mesh(*as<HasSurfaces>(made_.decoder()), name, asset.size, files_.resolution);
    if (mesh.triangle_count() == 0) {
      std::error_code error;
      fs::remove(path, error);  // of an earlier generation
      return;
    }
    MeshLabel label{text("generated ", kAssetClasses[asset.asset_class], " ", number_of(row)),
                    described(asset, number_of(row))};
    label.extras["resolution"] = files_.resolution;
    label.extras.update(made_.how());
    write_glb(path, mesh, label);
    row["mesh"] = path.filename().string();
    row["vertices"] = mesh.vertex_count();
    row["triangles"] = mesh.triangle_count();
  }

  const Generation& made_;
  const AssetFiles& files_;
  const Listener& listener_;
  std::size_t first_ = 0;  // how many were written before those of now
  AssetArrays latents_;
  Report rows_ = Report::array();
  std::vector<Image> grid_;
  std::vector<Caption> captions_;
};

}  // namespace

fs::path AssetFiles::grid() const { return folder / kGrid; }

Generation::Generation(const RestoredRun& prior, const AssetRequest& wish, const MadeBy& by)
    : prior_(*as<GeneratesAssets>(*prior.method)), wish_(wish), part_(wish) {
  StoredRun source = load_source(prior);
  how_ = how_made(prior, source, wish, by);
  part_.first = 0;
  part_.count = std::min(wish.count, kAtOnce);
  assets_ = prior_.generate(part_);  // before more is read: what is wished for may not be there
  decoder_ = restore_run(std::move(source));
  names_ = as<ShowsAssets>(*decoder_.method)->show_assets(assets_);
}

bool Generation::next() {
  part_.first += kAtOnce;
  part_.count = std::min(wish_.count - part_.first, kAtOnce);
  assets_ = part_.count > 0 ? prior_.generate(part_) : std::vector<NewAsset>();
  names_ = as<ShowsAssets>(*decoder_.method)->show_assets(assets_);
  return !assets_.empty();
}

Report write_assets(Generation& made, const AssetFiles& files, const Listener& listener, const Ranks& ranks) {
  std::error_code error;
  const bool first = ranks.rank() == 0;
  // Of an earlier generation, which may have had more; a folder that something else made is left alone.
  if (first && fs::exists(files.folder / kRecord, error)) fs::remove_all(files.folder / kPictures, error);
  meet(ranks);
  AssetWriter writer(made, files, listener);
  do writer.write_part(ranks);
  while (made.next());
  if (first) writer.write_rest();
  return writer.all();
}

}  // namespace cloam
