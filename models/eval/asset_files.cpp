// See asset_files.h.
#include "models/eval/asset_files.h"

#include <fmt/format.h>

#include <cmath>

#include "models/eval/pictures.h"
#include "models/io/commit.h"
#include "models/io/gif.h"
#include "models/latents/shows_assets.h"
#include "models/mesh/write_mesh.h"
#include "models/runs/actor_names.h"
#include "models/scene/asset_class.h"
#include "models/street/asset_mesh.h"
#include "runtime/error.h"

namespace cloam {
namespace {

namespace fs = std::filesystem;
using Report = nlohmann::ordered_json;

constexpr int kFramesPerSecond = 12;
constexpr char kPictures[] = "pictures", kGrid[] = "grid.png", kRecord[] = "generate.json";

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

Report described(const GeneratedAssets& made, std::size_t i) {
  const NewAsset& asset = made.assets[i];
  return {{"asset", i},
          {"class", kAssetClasses[asset.asset_class]},
          {"time", time_of_day(asset.night)},
          {"size_m", {asset.size.x(), asset.size.y(), asset.size.z()}}};
}

fs::path file_of(const AssetFiles& files, std::size_t asset, const char* extension) {
  return files.folder / fmt::format("asset_{:03}.{}", asset, extension);
}

void write_latents(const fs::path& path, const GeneratedAssets& made) {
  NewAssets all{made.assets, made.code_shape, {}};
  for (const auto& [key, value] : made.how.items())
    all.made[key] = value.is_string() ? value.get<std::string>() : value.dump();
  write_new_assets(path, all);
}

/// The mesh's file, or none (and a warning) where the asset has no surface.
void add_mesh(const AssetFiles& files, const GeneratedAssets& made, std::size_t i, Report& row,
              const Listener& listener) {
  const NewAsset& asset = made.assets[i];
  const fs::path path = file_of(files, i, "glb");
  const Mesh mesh = asset_mesh(street_of(made.decoder), made.names[i], asset.size, files.resolution);
  if (mesh.triangle_count() == 0) {
    std::error_code error;
    fs::remove(path, error);  // of an earlier generation
    return listener.warn(text("asset ", i, " has no surface in its box: no mesh is written"));
  }
  MeshLabel label{text("generated ", kAssetClasses[asset.asset_class], " ", i), described(made, i)};
  label.extras["resolution"] = files.resolution;
  label.extras.update(made.how);
  write_glb(path, mesh, label);
  row["mesh"] = path.filename().string();
  row["vertices"] = mesh.vertex_count();
  row["triangles"] = mesh.triangle_count();
}

/// For `distance`, which wants no loops but pictures.
void write_pictures(const AssetFiles& files, std::size_t asset, const std::vector<Image>& turn) {
  for (std::size_t i = 0; i < turn.size(); ++i) {
    write_png(files.folder / kPictures / fmt::format("asset_{:03}_{:04}.png", asset, i), turn[i]);
  }
}

/// Turntables, meshes and the grid; returns what there is of each asset.
Report write_each(const AssetFiles& files, const GeneratedAssets& made, const Listener& listener) {
  Report rows = Report::array();
  std::vector<Image> grid;
  std::vector<Caption> captions;
  for (std::size_t i = 0; i < made.assets.size(); ++i) {
    listener.check_stop([&] {
      return text(i, " of ", made.assets.size(), " assets are complete in ", files.folder.string(), ", without ", kGrid,
                  " and ", kRecord);
    });
    Report row = described(made, i);
    const std::vector<Image> turn =
        turntable(street_of(made.decoder), made.names[i], made.assets[i].size, files.frames, files.size);
    const fs::path gif = file_of(files, i, "gif");
    Report how = row;
    how.update(made.how);
    write_gif(gif, turn, kFramesPerSecond, how.dump());
    row["turntable"] = gif.filename().string();
    grid.push_back(three_quarter_picture(street_of(made.decoder), made.names[i], made.assets[i].size, files.size));
    captions.push_back({text(i, "  ", kAssetClasses[made.assets[i].asset_class]), time_of_day(made.assets[i].night)});
    if (files.pictures) write_pictures(files, i, turn);
    if (files.meshes) add_mesh(files, made, i, row, listener);
    listener.say(text("generate ", i + 1, "/", made.assets.size(), "  ", kAssetClasses[made.assets[i].asset_class],
                      ", ", time_of_day(made.assets[i].night)));
    rows.push_back(row);
  }
  const int columns = static_cast<int>(std::ceil(std::sqrt(static_cast<double>(grid.size()))));
  write_png(files.grid(), contact_sheet(grid, columns, captions), made.how.dump());
  return rows;
}

}  // namespace

fs::path AssetFiles::grid() const { return folder / kGrid; }

GeneratedAssets generate_assets(const RestoredRun& prior, const AssetRequest& wish, const MadeBy& by) {
  StoredRun source = read_source(prior);
  as<LearnsFromRun>(*prior.method)->load(source_of(source));
  auto& generates = *as<GeneratesAssets>(*prior.method);
  GeneratedAssets made;
  made.how = how_made(prior, source, wish, by);
  made.code_shape = generates.code_shape();
  made.assets = generates.generate(wish);
  made.decoder = restore_run(std::move(source));
  street_of(made.decoder);
  made.names = as<ShowsAssets>(*made.decoder.method)->show_assets(made.assets);
  return made;
}

Report write_assets(const GeneratedAssets& made, const AssetFiles& files, const Listener& listener) {
  std::error_code error;
  // Of an earlier generation, which may have had more; a folder that something else made is left alone.
  if (fs::exists(files.folder / kRecord, error)) fs::remove_all(files.folder / kPictures, error);
  write_latents(files.folder / "latents.safetensors", made);
  Report all = {{"schema_version", 1}, {"made", made.how}};
  all["assets"] = write_each(files, made, listener);
  commit_text(files.folder / kRecord, all.dump(2) + "\n");
  return all;
}

}  // namespace cloam
