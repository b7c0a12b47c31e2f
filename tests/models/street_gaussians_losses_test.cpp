// What Street Gaussians' training asks besides the colours of a picture, by closed form.
#include "models/methods/street_gaussians_losses.h"

#include <doctest/doctest.h>

#include <cmath>

#include "models/gaussians/values.h"
#include "models/io/host_random.h"
#include "tests/models/toy_street.h"

using namespace cloam;

TEST_CASE("street-gaussians: colours of actors' Gaussians in a picture are held to their actor's mean, hidden or not") {
  const Folder folder;
  Scene scene = toy_street(folder.path);
  scene.actors = {toy_actor("near", {2, 4, 3}, 10, 0), toy_actor("far", {2, 4, 3}, 20, 0)};
  StreetGaussiansConfig config;
  config.sky_side = 2;
  config.waves = 3;
  Params params;
  StreetGaussiansModel model(config, params, scene);
  StreetStart start;
  start.background = zero_gaussians(5, "test");
  start.owners = {0, 0, 0, 1, 1};
  const std::vector<bool> in_picture = {true, true, false, true, true};  // the far one's stand behind the near one's
  start.actors = zero_gaussians(5, "test");
  HostRandom random(8, 0);
  for (size_t i = 0; i < 5; ++i) {
    start.actors.opacities[i] = 5;
    start.actors.means[3 * i + 1] = in_picture[i] ? 0.1f * static_cast<float>(i) : 400.f;
    start.background.means[3 * i] = 15;
  }
  for (std::vector<float>* values : {&start.actors.sh_first, &start.actors.sh_rest})
    for (float& value : *values) value = static_cast<float>(random.between(-1, 1));
  model.put(start);
  std::vector<float> waves;
  for (int i = 0; i < 5 * 2 * 3; ++i) waves.push_back(static_cast<float>(random.between(-1, 1)));
  params[kWavesName] = parameter(waves, {5, 2, 3});

  const Camera& camera = scene.cameras[0];
  const SeenStreet seen{
      {}, draw(model.projection({camera, scene.frames[0].world_from_camera, 0, 0}, {}, 3), camera, {}), {}, 32 * 24};
  double sum = 0;
  std::vector<double> toward;  // d term / d sh_first
  for (size_t i = 0; i < 5; ++i) {
    for (size_t c = 0; c < 3; ++c) {
      double mean = 0;
      for (size_t k = 0; k < 5; ++k)
        if (start.owners[k] == start.owners[i]) mean += double{start.actors.sh_first[3 * k + c]} / (i < 3 ? 3 : 2);
      const double off = in_picture[i] ? double{start.actors.sh_first[3 * i + c]} - mean : 0;
      sum += off * off;
      toward.push_back(off);
    }
    if (!in_picture[i]) continue;
    for (size_t c = 0; c < 45; ++c) sum += std::pow(double{start.actors.sh_rest[45 * i + c]}, 2);
    for (size_t c = 0; c < 6; ++c) sum += std::pow(double{waves[6 * i + c]}, 2);
  }
  const Tensor term = (32.f * 24.f) * hidden_term(seen, model);
  CHECK(double{term.item()} == doctest::Approx(0.5 * sum).epsilon(1e-5));
  const std::vector<Tensor> gradients =
      grad(term, {params.at("actors.sh_first"), params.at("actors.sh_rest"), params.at(kWavesName)});
  const auto check = [&](const Tensor& gradient, const auto& expected) {
    const std::vector<float> found = gradient.to_host();
    for (size_t i = 0; i < found.size(); ++i) CHECK(std::abs(double{found[i]} - double{expected[i]}) < 1e-5);
  };
  check(gradients[0], toward);
  for (size_t c = 0; c < 45; ++c) start.actors.sh_rest[2 * 45 + c] = 0;  // the one that is not in the picture
  for (size_t c = 0; c < 6; ++c) waves[2 * 6 + c] = 0;
  check(gradients[1], start.actors.sh_rest);
  check(gradients[2], waves);
}
