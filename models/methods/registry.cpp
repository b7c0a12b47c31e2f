// Methods and presets.
#include "models/methods/registry.h"

#include <algorithm>
#include <set>
#include <sstream>
#include <type_traits>

#include "models/gaussians/adopts_actors.h"
#include "models/gaussians/exports_actors.h"
#include "models/io/words.h"
#include "models/methods/diffusion.h"
#include "models/methods/genassets.h"
#include "models/methods/nerf.h"
#include "models/methods/neurad.h"
#include "models/methods/splat.h"
#include "models/methods/street_gaussians.h"
#include "models/methods/zipnerf.h"
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
using All =
    List<LearnsFromCaptures, LearnsFromRun, RendersViews, Street, HasSurfaces, HasSurroundings, Grows, SharesNetworks,
         TakesPrior, GeneratesAssets, ShowsAssets, ExportsGaussians, ExportsActors, AdoptsActors, MixedPrecision>;

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
  static const std::vector<MethodRow> rows = {row<Nerf>("nerf"),           row<Splat>("splat"),
                                              row<GenAssets>("genassets"), row<StreetGaussians>("street-gaussians"),
                                              row<Neurad>("neurad"),       row<ZipNerf>("zipnerf"),
                                              row<Diffusion>("diffusion")};
  return rows;
}

/// What the same method is called elsewhere.
const std::pair<const char*, const char*> kAliases[] = {
    {"3dgs", "splat"},    {"splatfacto", "splat"}, {"gaussian-splatting", "splat"},
    {"gsplat", "splat"},  {"instant-ngp", "nerf"}, {"ngp", "nerf"},
    {"nerfacto", "nerf"}, {"zip-nerf", "zipnerf"},
};

/// "field.kind=frequency sampling=importance". Of settings given twice the later one stands.
Preset::Settings settings_in(const std::string& words) {
  Preset::Settings settings;
  std::istringstream in(words);
  for (std::string word; in >> word;) {
    const size_t at = word.find('=');
    settings.push_back({word.substr(0, at), word.substr(at + 1)});
  }
  return settings;
}

[[noreturn]] void unknown(const char* what, const std::string& name, const std::vector<std::string>& names) {
  throw Error(Fault::usage,
              text("unknown ", what, " ", name, did_you_mean(name, names), "\n  want one of ", joined(names)));
}

}  // namespace

const std::vector<Preset>& presets() {
  const std::string street =
      "background.side=512 code.channels=16 decoder.widths=64,32,32,16 decoder.middle=64 decoder.groups=8 "
      "field.width=32 image.kernel=3 image.blocks=4 image.upsamplings=1 actors.symmetric=true "
      "weight.adversarial=0 weight.kl=1e-8 batch.object_side=96 batch.lidar_rays=512 train.rate_decoder=1e-3 "
      "train.rate_field=5e-3 "
      "train.rate_image=4e-3 train.rate_background=0.05 ";
  // Switches off all that the paper does not have.
  const std::string faithful =
      "actors.symmetric=false beyond.common_background=false beyond.code_bypass=false beyond.class_places=false "
      "beyond.detail=false beyond.field_bypass=false beyond.field_residual=false beyond.image_bypass=false "
      "beyond.linear_lidar=false weight.line_of_sight=0 weight.adversarial=0.001 weight.kl=1e-5 ";
  const std::string whole = "batch.whole_images=true batch.lidar_rays=8192 ";
  // UniSim (Yang et al. 2023), as far as its way differs: each actor learns its own features, which nothing mirrors and
  // which cast no shadow; finer steps, a deeper sky, a narrower distance network.
  const std::string unisim =
      "decoder.use=false actors.symmetric=false shadows=false steps.background=0.2 steps.sky=16 field.width=32 "
      "beyond.linear_lidar=false ";
  static const std::vector<Preset> rows = {
      {"nerf", "nerf", "hash grid and occupancy grid: minutes on two cores", {}, 4000},
      {"nerf-paper", "nerf", "the paper's 8x256 network, 64 + 128 samples",
       settings_in("field.kind=frequency field.width=256 sampling=importance background=white batch.rays=1024 "
                   "weight.distortion=0 "
                   "train.rate=5e-4 train.final_rate=0.1 train.decay_steps=250000"),
       200000},
      {"splat", "splat", "Gaussian splatting of posed photos", {}, 7000},
      {"genassets", "genassets", "the paper's sizes: needs a cluster; one step on two cores", settings_in(whole), 0,
       100},
      {"genassets-faithful", "genassets", "the same without what the paper does not have",
       settings_in(whole + faithful), 0, 100},
      {"genassets-small", "genassets", "streets and their actors: minutes on two cores", settings_in(street), 7000},
      {"genassets-small-faithful", "genassets", "the same without what the paper does not have",
       settings_in(street + faithful), 7000},
      {"genassets-unisim", "genassets", "UniSim's way: each actor's planes learned directly, finer steps",
       settings_in(whole + unisim), 0, 100},
      {"genassets-small-unisim", "genassets", "the same for minutes on two cores", settings_in(street + unisim), 7000},
      {"diffusion", "diffusion", "the paper's sizes: assets of a genassets run", {}, 100000},
      {"diffusion-small", "diffusion", "assets of a genassets-small run: minutes on two cores",
       settings_in("unet.base=32 unet.multipliers=1,2 unet.groups=8 batch.codes=64 train.rate=1e-3 "
                   "train.final_rate=0.1 train.ema=0.999 beyond.wiener=true"),
       4000},
      {"street-gaussians", "street-gaussians", "the paper's sizes: an hour on a GPU", {}, 30000},
      {"street-gaussians-small", "street-gaussians", "one log with its actors: minutes on two cores",
       settings_in("initial.lidar=20000 initial.near=2000 initial.far=3000 initial.actor=2000 initial.fewest=200 "
                   "sky.side=128 growth.max=60000 actors.max=60000"),
       3000},
      {"neurad", "neurad", "the paper's sizes: hours on a GPU; one step on two cores", {}, 20000},
      {"neurad-small", "neurad", "one log with its actors and LiDAR: minutes on two cores",
       settings_in("grid.log2_rows=17 grid.finest=2048 actors.log2_rows=12 actors.coarsest=16 actors.finest=128 "
                   "image.kernel=3 batch.patches=4 batch.lidar_rays=1024 weight.perceptual=0 train.warm_up=30 "
                   "train.warm_up_image=30 train.rate_image=4e-3"),
       4000},
      {"zipnerf", "zipnerf", "the paper's sizes: an hour on several GPUs", settings_in("space.unit=path"), 25000},
      {"zipnerf-small", "zipnerf", "anti-aliased hash grid: minutes on two cores",
       settings_in("space.unit=path grid.levels=8 grid.log2_rows=16 grid.finest=1024 field.bottleneck=16 "
                   "field.colour_width=64 "
                   "field.density=exp "
                   "proposal1.levels=4 proposal1.finest=128 proposal2.levels=5 proposal2.finest=256 "
                   "proposals.log2_rows=15 proposals.width=16 samples.proposal=32 samples.field=16 "
                   "sampling.proposal_multisamples=1 batch.rays=2048 batch.coarse=0.5 train.loss=square "
                   "train.warm_up=30 weight.distortion=0.002 weight.decay=0.01 weight.depth=0.03"),
       2000},
      // The ablations of GenAssets' Table A2.
      {"genassets-small-nokl", "genassets", "the same without variational codes",
       settings_in(street + "weight.kl=0 code.variational=false"), 7000},
      {"genassets-small-noperceptual", "genassets", "the same without the perceptual loss",
       settings_in(street + "weight.perceptual=0"), 7000},
      {"genassets-small-nodecoder", "genassets", "each actor's planes learned directly, without decoder or symmetry",
       settings_in(street + "decoder.use=false actors.symmetric=false"), 7000},
  };
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

std::vector<std::string> preset_names() {
  std::vector<std::string> names;
  for (const Preset& preset : presets()) names.push_back(preset.name);
  return names;
}

std::vector<std::string> presets_of(const std::string& method) {
  std::vector<std::string> names;
  for (const Preset& preset : presets())
    if (method == preset.method) names.push_back(preset.name);
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
