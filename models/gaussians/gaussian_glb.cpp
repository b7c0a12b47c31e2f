// See gaussian_glb.h.
#include "models/gaussians/gaussian_glb.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "models/gaussians/turn.h"
#include "models/gaussians/values.h"
#include "models/io/bytes.h"
#include "models/io/glb.h"
#include "models/io/json.h"
#include "models/io/srgb.h"
#include "runtime/error.h"

namespace cloam {
namespace {

using Eigen::Matrix4d;

constexpr char kExtension[] = "KHR_gaussian_splatting";
constexpr int kPoints = 0;
constexpr double kFloatStep = 6e-8;        // opacities 0 and 1 stand for what a float cannot tell from them
constexpr double kSimilarityError = 1e-3;  // relative

std::string attribute(const std::string& name) { return text(kExtension, ":", name); }

struct Coefficient {
  std::string name;
  std::size_t place;  // in a gaussian's further coefficients
};

std::vector<Coefficient> coefficients_of(int degree) {
  std::vector<Coefficient> all;
  for (int l = 1; l <= degree; ++l) {
    for (int n = 0; n <= 2 * l; ++n) all.push_back({attribute(text("SH_DEGREE_", l, "_COEF_", n)), all.size()});
  }
  return all;
}

// ---- accessors

struct Component {
  int type;
  std::size_t bytes;
  double (*read)(const std::uint8_t*);
  double max;  // what a normalised value is a part of
};

template <class Stored>
double read_as(const std::uint8_t* bytes) {
  return static_cast<double>(number_at<Stored>(bytes));
}

constexpr Component kComponents[] = {
    {gltf::kByte, 1, read_as<std::int8_t>, 127},
    {gltf::kUnsignedByte, 1, read_as<std::uint8_t>, 255},
    {gltf::kShort, 2, read_as<std::int16_t>, 32767},
    {gltf::kUnsignedShort, 2, read_as<std::uint16_t>, 65535},
    {gltf::kFloat, 4, read_as<float>, 1},
};

struct Shape {
  const char* name;
  std::size_t width;
};
constexpr Shape kScalar{"SCALAR", 1}, kVector{"VEC3", 3}, kQuaternion{"VEC4", 4};

/// A document and the bytes that its accessors point into.
class Document {
 public:
  explicit Document(const std::filesystem::path& path) : name_(path.string()) {
    GlbChunks chunks = read_glb_chunks(path);
    content_ = std::move(chunks.content);
    json_ = parse_json(chunks.json, name_);
  }

  const std::string& name() const { return name_; }
  const Json& json() const { return json_; }
  [[noreturn]] void fail(const std::string& why) const { bad_data(name_ + ": " + why); }

  /// The `index`-th of "nodes", "accessors" and the like.
  const Json& item(const char* list, std::uint64_t index) const {
    const Json& items = array(json_, list, name_);
    if (index >= items.size()) fail(text(list, " ", index, " does not exist: there are ", items.size()));
    return items[index];
  }

  /// A number that counts or names something.
  std::uint64_t whole(const Json& object, const char* key) const {
    const Json& value = member(object, key, name_);
    if (!value.is_number_unsigned())
      fail(text(key, " is ", value.dump().substr(0, 40), ", want a whole number from 0"));
    return value.get<std::uint64_t>();
  }
  std::uint64_t whole(const Json& object, const char* key, std::uint64_t otherwise) const {
    return object.contains(key) ? whole(object, key) : otherwise;
  }

  /// All values of an accessor, as float; `count` of the shape's width.
  std::vector<float> values(std::uint64_t index, const Shape& shape, std::uint64_t count) const {
    const Json& accessor = item("accessors", index);
    const std::string where = text(name_, ": accessors ", index);
    if (accessor.contains("sparse")) fail(text("accessors ", index, " is sparse, which is not supported"));
    if (string(accessor, "type", where) != shape.name || whole(accessor, "count") != count) {
      fail(text("accessors ", index, " is of another type or count, want ", count, " of ", shape.name));
    }
    const Component& component = component_of(whole(accessor, "componentType"));
    const Json& view = item("bufferViews", whole(accessor, "bufferView"));
    if (whole(view, "buffer") != 0) fail("has a second buffer, want all data within the file");
    const std::uint64_t element = component.bytes * shape.width, stride = whole(view, "byteStride", element);
    const std::uint64_t begin = whole(view, "byteOffset", 0), size = whole(view, "byteLength");
    const std::uint64_t offset = whole(accessor, "byteOffset", 0);
    if (begin > content_.size() || size > content_.size() - begin) fail("a buffer view reaches beyond the buffer");
    // count times stride cannot overflow: both are below 2^32 where this passes so far.
    const bool fits = stride >= element && stride < 256 && offset <= size && count > 0 && count <= size &&
                      (count - 1) * stride + element <= size - offset;
    if (!fits) fail(text("accessors ", index, " reaches beyond its buffer view"));
    const double unit = flag(accessor, "normalized", false, where) ? 1 / component.max : 1;
    std::vector<float> values;
    values.reserve(count * shape.width);
    for (std::uint64_t i = 0; i < count; ++i) {
      const std::uint8_t* at = content_.data() + begin + offset + i * stride;
      for (std::size_t k = 0; k < shape.width; ++k) {
        values.push_back(static_cast<float>(unit * component.read(at + k * component.bytes)));
      }
    }
    return values;
  }

 private:
  const Component& component_of(std::uint64_t type) const {
    for (const Component& component : kComponents) {
      if (type == static_cast<std::uint64_t>(component.type)) return component;
    }
    fail(text("an accessor has components of type ", type, ", want float or integers of 8 or 16 bits"));
  }

  std::string name_;
  Json json_;
  std::vector<std::uint8_t> content_;
};

// ---- primitives

bool is_splat(const Json& primitive) {
  return primitive.is_object() && primitive.contains("extensions") && primitive.at("extensions").is_object() &&
         primitive.at("extensions").contains(kExtension);
}

void check_extension(const Document& document, const Json& primitive, std::vector<std::string>& warnings) {
  const Json& extension = member(primitive.at("extensions"), kExtension, document.name());
  const std::string kernel = string(extension, "kernel", document.name());
  if (kernel != "ellipse") document.fail("its Gaussians have the kernel '" + kernel + "', want ellipse");
  if (extension.contains("extensions") && !extension.at("extensions").empty()) {
    document.fail("its Gaussians are compressed by an unsupported extension: save it without compression");
  }
  if (document.whole(primitive, "mode", 4) != kPoints) document.fail("its Gaussians are not points (mode 0)");
  if (string(extension, "colorSpace", document.name()) != "srgb_rec709_display") {
    warnings.push_back(document.name() + ": its colours are not sRGB; they are used unchanged");
  }
}

// The highest degree that begins must be whole, as must all below it: a missing attribute is an error.
int degree_in(const Json& attributes) {
  int degree = 0;
  for (int l = 1; l <= kSphericalBands; ++l) {
    if (attributes.contains(attribute(text("SH_DEGREE_", l, "_COEF_0")))) degree = l;
  }
  return degree;
}

Gaussians read_primitive(const Document& document, const Json& primitive) {
  const Json& attributes = member(primitive, "attributes", document.name());
  const std::uint64_t places = document.whole(attributes, "POSITION");
  const std::uint64_t count = document.whole(document.item("accessors", places), "count");
  const auto values = [&](const std::string& name, const Shape& shape) {
    return document.values(document.whole(attributes, name.c_str()), shape, count);
  };
  std::vector<float> means = document.values(places, kVector, count);  // checks the count before memory is asked for
  Gaussians gaussians = zero_gaussians(count, document.name());
  gaussians.means = std::move(means);
  gaussians.scales = values(attribute("SCALE"), kVector);
  for (float& value : gaussians.scales) value = log_scale(double(value));
  gaussians.opacities = values(attribute("OPACITY"), kScalar);
  for (float& value : gaussians.opacities) value = logit(double(value), kFloatStep);
  gaussians.rotations = values(attribute("ROTATION"), kQuaternion);
  for (std::size_t g = 0; g < count; ++g) {  // from x y z w
    std::rotate(&gaussians.rotations[4 * g], &gaussians.rotations[4 * g + 3], &gaussians.rotations[4 * g] + 4);
  }
  gaussians.sh_first = values(attribute("SH_DEGREE_0_COEF_0"), kVector);
  for (const Coefficient& coefficient : coefficients_of(degree_in(attributes))) {
    const std::vector<float> rgb = values(coefficient.name, kVector);
    for (std::size_t g = 0; g < count; ++g) {
      std::copy_n(&rgb[3 * g], 3, &gaussians.sh_rest[3 * (kSphericalRest * g + coefficient.place)]);
    }
  }
  return gaussians;
}

// ---- nodes

template <int size>
Eigen::Matrix<double, size, 1> numbers(const Document& document, const Json& node, const char* key) {
  const Json& list = array(node, key, document.name());
  Eigen::Matrix<double, size, 1> result;
  if (list.size() != size) document.fail(text("a node's ", key, " has ", list.size(), " numbers, want ", size));
  for (int i = 0; i < size; ++i) {
    const Json& value = list[static_cast<std::size_t>(i)];
    if (!value.is_number()) document.fail(text("a node's ", key, " holds a value that is not a number"));
    result[i] = value.get<double>();
  }
  return result;
}

Matrix4d parent_from_node(const Document& document, const Json& node) {
  if (node.contains("matrix")) {
    const Eigen::Matrix<double, 16, 1> by_column = numbers<16>(document, node, "matrix");
    return Eigen::Map<const Matrix4d>(by_column.data());
  }
  Eigen::Affine3d place = Eigen::Affine3d::Identity();
  if (node.contains("translation")) place.translate(numbers<3>(document, node, "translation"));
  if (node.contains("rotation")) {
    const Eigen::Vector4d xyzw = numbers<4>(document, node, "rotation");
    place.rotate(Eigen::Quaterniond(xyzw.data()).normalized());
  }
  if (node.contains("scale")) place.scale(numbers<3>(document, node, "scale"));
  return place.matrix();
}

Similarity similarity_of(const Document& document, const Matrix4d& world_from_node) {
  const Eigen::Matrix3d linear = world_from_node.topLeftCorner<3, 3>();
  const double scale = std::cbrt(linear.determinant());
  if (!world_from_node.allFinite() || !(scale > 0)) document.fail("a node mirrors or flattens its Gaussians");
  const Eigen::Matrix3d rotation = linear / scale;
  if (!(rotation * rotation.transpose()).isIdentity(kSimilarityError)) {
    document.fail("a node shears its Gaussians or scales them unevenly, which is not supported");
  }
  // The nearest rotation: what is left of scale and shear is rounding.
  return {Eigen::Quaterniond(rotation).normalized().toRotationMatrix(), scale, world_from_node.topRightCorner<3, 1>()};
}

class SceneReader {
 public:
  explicit SceneReader(const Document& document) : document_(document) {}

  SplatFile read() {
    for (const Json& root : roots()) visit(root, Matrix4d::Identity());
    if (found_ == 0) {
      document_.fail(
          text("has no Gaussians: looked for a mesh with ", kExtension, "; triangle meshes are not supported"));
    }
    result_.gaussians.up = Eigen::Vector3d::UnitY();
    return std::move(result_);
  }

 private:
  Json roots() const {
    const Json& json = document_.json();
    if (!json.is_object() || !json.contains("scenes")) document_.fail("has no scene");
    const Json& scene = document_.item("scenes", document_.whole(json, "scene", 0));
    return scene.contains("nodes") ? array(scene, "nodes", document_.name()) : Json::array();
  }

  void visit(const Json& named, const Matrix4d& world_from_parent) {
    if (!named.is_number_unsigned())
      document_.fail("a scene or node refers to a node by a value that is not a whole number");
    const auto index = named.get<std::uint64_t>();
    const Json& node = document_.item("nodes", index);
    if (!node.is_object()) document_.fail(text("nodes ", index, " is not an object"));
    if (!visited_.insert(index).second) document_.fail(text("nodes ", index, " appears twice in the scene"));
    const Matrix4d world_from_node = world_from_parent * parent_from_node(document_, node);
    if (node.contains("mesh")) read_mesh(document_.item("meshes", document_.whole(node, "mesh")), world_from_node);
    if (!node.contains("children")) return;
    if (++depth_ > kDeepest) document_.fail(text("has nodes nested deeper than ", kDeepest));
    for (const Json& child : array(node, "children", document_.name())) visit(child, world_from_node);
    --depth_;
  }

  void read_mesh(const Json& mesh, const Matrix4d& world_from_node) {
    for (const Json& primitive : array(mesh, "primitives", document_.name())) {
      if (!is_splat(primitive)) continue;
      check_extension(document_, primitive, result_.warnings);
      Gaussians gaussians = read_primitive(document_, primitive);
      check_count(result_.gaussians.count() + gaussians.count(), document_.name());
      if (!world_from_node.isIdentity(0)) transform(gaussians, similarity_of(document_, world_from_node));
      append(result_.gaussians, gaussians);
      ++found_;
    }
  }

  static constexpr int kDeepest = 256;
  const Document& document_;
  SplatFile result_;
  std::set<std::uint64_t> visited_;
  int found_ = 0, depth_ = 0;
};

bool is_metric(const Json& json) {
  const Json* at = &json;
  for (const char* key : {"asset", "extras", "metric"}) {
    if (!at->is_object() || !at->contains(key)) return false;
    at = &at->at(key);
  }
  return *at == true;
}

// ---- writing

std::vector<float> applied(const std::vector<float>& values, double (*function)(double)) {
  std::vector<float> result(values.size());
  std::transform(values.begin(), values.end(), result.begin(),
                 [=](float value) { return static_cast<float>(function(double(value))); });
  return result;
}

std::vector<float> rotations_xyzw(const Gaussians& gaussians) {
  std::vector<float> all;
  all.reserve(gaussians.rotations.size());
  for (std::size_t g = 0; g < gaussians.count(); ++g) {
    const Eigen::Vector4d wxyz =
        Eigen::Map<const Eigen::Vector4f>(&gaussians.rotations[4 * g]).cast<double>().normalized();
    for (const int i : {1, 2, 3, 0}) all.push_back(static_cast<float>(wxyz[i]));
  }
  return all;
}

std::vector<std::uint8_t> point_colours(const Gaussians& gaussians) {
  std::vector<std::uint8_t> rgba;
  rgba.reserve(4 * gaussians.count());
  for (std::size_t g = 0; g < gaussians.count(); ++g) {
    for (std::size_t c = 0; c < 3; ++c) {
      const double srgb = 0.5 + kSphericalFirst * double(gaussians.sh_first[3 * g + c]);
      rgba.push_back(to_byte(255 * double(linear_colour(static_cast<float>(srgb)))));
    }
    rgba.push_back(byte_of_logit(gaussians.opacities[g]));
  }
  return rgba;
}

std::vector<float> coefficient_values(const Gaussians& gaussians, std::size_t place) {
  std::vector<float> rgb;
  rgb.reserve(3 * gaussians.count());
  for (std::size_t g = 0; g < gaussians.count(); ++g) {
    const float* at = &gaussians.sh_rest[3 * (kSphericalRest * g + place)];
    rgb.insert(rgb.end(), at, at + 3);
  }
  return rgb;
}

}  // namespace

SplatFile read_gaussian_glb(const std::filesystem::path& path) {
  const Document document(path);
  SplatFile file = SceneReader(document).read();
  file.gaussians.metric = is_metric(document.json());
  return file;
}

void write_gaussian_glb(const std::filesystem::path& path, const Gaussians& given) {
  using Ordered = nlohmann::ordered_json;
  const Gaussians gaussians = turned(given, Eigen::Vector3d::UnitY());
  GlbBuffer buffer;
  Ordered attributes;
  attributes["POSITION"] = buffer.add_positions(gaussians.means);
  attributes["COLOR_0"] = buffer.add_colours(point_colours(gaussians));
  attributes[attribute("ROTATION")] = buffer.add_vertices(rotations_xyzw(gaussians), kQuaternion.name);
  attributes[attribute("SCALE")] =
      buffer.add_vertices(applied(gaussians.scales, [](double value) { return std::exp(value); }), kVector.name);
  attributes[attribute("OPACITY")] = buffer.add_vertices(applied(gaussians.opacities, sigmoid), kScalar.name);
  attributes[attribute("SH_DEGREE_0_COEF_0")] = buffer.add_vertices(gaussians.sh_first, kVector.name);
  for (const Coefficient& coefficient : coefficients_of(degree_of(gaussians))) {
    attributes[coefficient.name] = buffer.add_vertices(coefficient_values(gaussians, coefficient.place), kVector.name);
  }
  const Ordered extension = {{kExtension, {{"kernel", "ellipse"}, {"colorSpace", "srgb_rec709_display"}}}};
  const Ordered primitive = {{"attributes", attributes}, {"mode", kPoints}, {"extensions", extension}};
  buffer.write(path, {{"asset", {{"version", "2.0"}, {"generator", "cloam"}, {"extras", {{"metric", given.metric}}}}},
                      {"extensionsUsed", {kExtension}},
                      {"scene", 0},
                      {"scenes", {{{"nodes", {0}}}}},
                      {"nodes", {{{"mesh", 0}}}},
                      {"meshes", {{{"primitives", {primitive}}}}}});
}

}  // namespace cloam
