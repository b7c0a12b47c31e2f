// Methods and presets.
#include "models/methods/registry.h"

#include <algorithm>
#include <set>
#include <type_traits>

#include "models/io/words.h"
#include "models/methods/diffusion.h"
#include "models/methods/genassets.h"
#include "models/methods/nerf.h"
#include "models/methods/splat.h"
#include "runtime/error.h"

namespace cloam {
namespace {

struct MethodRow {
  const char* name;
  std::unique_ptr<Method> (*create)();
  std::set<std::type_index> capabilities;
};

template <class... Capabilities>
struct List {};
using All = List<LearnsFromCaptures, LearnsFromRun, RendersViews, Street, Grows, SharesNetworks, TakesPrior,
                 GeneratesAssets, ShowsAssets, ExportsGaussians>;

template <class M, class... Capabilities>
std::set<std::type_index> capabilities_of(List<Capabilities...>) {
  std::set<std::type_index> found;
  ((std::is_base_of_v<Capabilities, M> ? (void)found.insert(typeid(Capabilities)) : void()), ...);
  return found;
}

template <class M>
MethodRow row(const char* name) {
  return {name, [] { return std::unique_ptr<Method>(std::make_unique<M>()); }, capabilities_of<M>(All())};
}

const std::vector<MethodRow>& methods() {
  static const std::vector<MethodRow> rows = {row<Nerf>("nerf"), row<Splat>("splat"), row<GenAssets>("genassets"),
                                              row<Diffusion>("diffusion")};
  return rows;
}

/// What the same method is called elsewhere.
const std::pair<const char*, const char*> kAliases[] = {
    {"3dgs", "splat"},    {"splatfacto", "splat"}, {"gaussian-splatting", "splat"},
    {"gsplat", "splat"},  {"instant-ngp", "nerf"}, {"ngp", "nerf"},
    {"nerfacto", "nerf"},
};

/// A preset that differs from another, named first.
struct Variant {
  std::string base;
  const char *name, *summary;
  Preset::Settings differences;
};

// The ablations of GenAssets' Table A2.
const Variant kVariants[] = {
    {"genassets-small",
     "genassets-small-nokl",
     "the same without variational codes",
     {{"weight.kl", "0"}, {"code.variational", "false"}}},
    {"genassets-small",
     "genassets-small-noperceptual",
     "the same without the perceptual loss",
     {{"weight.perceptual", "0"}}},
    {"genassets-small",
     "genassets-small-nodecoder",
     "each actor's planes learned directly, without decoder or symmetry",
     {{"decoder.use", "false"}, {"actors.symmetric", "false"}}},
};

std::vector<Preset> with_variants(std::vector<Preset> rows) {
  for (const Variant& variant : kVariants) {
    Preset preset =
        *std::find_if(rows.begin(), rows.end(), [&](const Preset& row) { return variant.base == row.name; });
    preset.name = variant.name;
    preset.summary = variant.summary;
    // Of settings given twice the later one stands.
    preset.settings.insert(preset.settings.end(), variant.differences.begin(), variant.differences.end());
    rows.push_back(preset);
  }
  return rows;
}

[[noreturn]] void unknown(const char* what, const std::string& name, const std::vector<std::string>& names) {
  const std::string nearest = nearest_name(name, names);
  std::string known;
  for (const std::string& one : names) known += (known.empty() ? "" : ", ") + one;
  throw Error(Fault::usage, text("unknown ", what, " ", name, nearest.empty() ? "" : "; did you mean " + nearest + "?",
                                 "\n  want one of ", known));
}

}  // namespace

const std::vector<Preset>& presets() {
  static const std::vector<Preset> rows = with_variants({
      {"nerf", "nerf", "hash grid and occupancy grid: minutes on two cores", {}, 4000},
      {"nerf-paper",
       "nerf",
       "the paper's 8x256 network, 64 + 128 samples",
       {{"field.kind", "frequency"},
        {"field.width", "256"},
        {"sampling", "importance"},
        {"background", "white"},
        {"batch.rays", "1024"},
        {"train.rate", "5e-4"},
        {"train.final_rate", "0.1"},
        {"train.decay_steps", "250000"}},
       200000},
      {"splat", "splat", "Gaussian splatting of posed photos", {}, 7000},
      {"genassets",
       "genassets",
       "the paper's sizes: needs a cluster; one step on two cores",
       {{"batch.whole_images", "true"}, {"batch.lidar_rays", "8192"}},
       400000},
      {"genassets-small",
       "genassets",
       "streets and their actors: minutes on two cores",
       {{"background.side", "512"},
        {"code.channels", "16"},
        {"decoder.widths", "64,32,32,16"},
        {"decoder.middle", "64"},
        {"decoder.groups", "8"},
        {"field.width", "32"},
        {"image.kernel", "3"},
        {"image.blocks", "4"},
        {"image.upsamplings", "1"},
        {"steps.actor", "0.1"},
        {"actors.symmetric", "true"},
        {"weight.adversarial", "0"},
        {"batch.lidar_rays", "512"},
        {"train.rate_decoder", "1e-3"},
        {"train.rate_field", "5e-3"},
        {"train.rate_image", "4e-3"},
        {"train.rate_background", "0.05"}},
       7000},
      {"diffusion", "diffusion", "the paper's sizes: assets of a genassets run", {}, 100000},
      {"diffusion-small",
       "diffusion",
       "assets of a genassets-small run: minutes on two cores",
       {{"unet.base", "32"},
        {"unet.multipliers", "1,2"},
        {"unet.groups", "8"},
        {"batch.codes", "64"},
        {"train.rate", "1e-3"},
        {"train.final_rate", "0.1"},
        {"train.ema", "0.999"}},
       4000},
  });
  return rows;
}

std::vector<std::string> method_names() {
  std::vector<std::string> names;
  for (const MethodRow& row : methods()) names.push_back(row.name);
  return names;
}

std::vector<std::string> methods_with(std::type_index capability) {
  std::vector<std::string> names;
  for (const MethodRow& row : methods())
    if (row.capabilities.contains(capability)) names.push_back(row.name);
  return names;
}

void lacks(const std::string& method, const std::string& what, std::type_index capability) {
  std::string others;
  for (const std::string& name : methods_with(capability)) others += (others.empty() ? "" : ", ") + name;
  throw Error(Fault::usage, text(what, " does not work with ", method, "\n  methods that it works with: ", others));
}

std::string method_of_alias(const std::string& name) {
  for (const auto& [alias, method] : kAliases)
    if (name == alias) return method;
  return name;
}

const Preset& find_preset(const std::string& name) {
  std::vector<std::string> names;
  for (const Preset& preset : presets()) {
    if (name == preset.name) return preset;
    names.push_back(preset.name);
  }
  unknown("preset", name, names);
}

std::unique_ptr<Method> make_method(const std::string& name) {
  for (const MethodRow& row : methods())
    if (name == row.name) return row.create();
  unknown("method", name, method_names());
}

}  // namespace cloam
