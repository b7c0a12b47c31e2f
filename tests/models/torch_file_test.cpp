// Files of PyTorch by bytes written by hand, sound ones and broken ones, and the checksums by which files are known.
#include "models/io/torch_file.h"

#include <doctest/doctest.h>

#include "models/io/sha256.h"
#include "models/io/weights.h"
#include "models/nn/known_weights.h"
#include "tests/hostile_pickles.h"
#include "tests/models/errors.h"
#include "tests/models/folder.h"
#include "tests/models/zip_bytes.h"

using namespace cloam;
using namespace std::string_literals;

namespace {

namespace fs = std::filesystem;
using hostile::name, hostile::whole;

std::string word(const std::string& content) { return hostile::text(content); }

std::string sizes(const std::vector<std::int64_t>& numbers) {
  std::string all = "(";
  for (const std::int64_t number : numbers) all += whole(number);
  return all + "t";
}

struct Part {
  std::string key = "0", type = "FloatStorage";
  std::int64_t count = 6, offset = 0;
  std::vector<std::int64_t> shape = {2, 3}, strides = {3, 1};

  std::string storage() const {
    return "(" + word("storage") + name("torch", type) + word(key) + word("cpu") + whole(count) + "tQ";
  }
  std::string place() const { return storage() + whole(offset) + sizes(shape) + sizes(strides); }
  /// As every PyTorch since 0.4 writes it.
  std::string tensor() const {
    return name("torch._utils", "_rebuild_tensor_v2") + "(" + place() + "\x89" + name("collections", "OrderedDict") +
           ")RtR";
  }
  std::string with(const std::string& before, const std::string& after) const { return before + place() + after; }
};

std::string state_dict(const std::vector<std::pair<std::string, std::string>>& items) {
  std::string all = "\x80\x02" + name("collections", "OrderedDict") + ")R(";
  for (const auto& [key, value] : items) all += word(key) + value;
  return all + "u}" + word("_metadata") + name("collections", "OrderedDict") + ")Rsb.";
}

Bytes bytes_of(const std::string& content) { return {content.begin(), content.end()}; }

template <class Number>
Bytes raw(const std::vector<Number>& values) {
  Bytes bytes(values.size() * sizeof(Number));
  std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

const std::vector<float> kSix = {1, 2, 3, 4, 5, 6};

std::vector<Member> members(const std::string& pickle, const std::vector<float>& values = kSix) {
  return {{"archive/data.pkl", bytes_of(pickle)},
          {"archive/byteorder", bytes_of("little")},
          {"archive/data/0", raw(values)},
          {"archive/data/1", raw(std::vector<std::int64_t>{7})},
          {"archive/version", bytes_of("3\n")}};
}

/// Before 1.6. storages: what follows the list of keys.
Bytes old_file(const std::string& pickle, const std::string& keys, const Bytes& storages) {
  Bytes all;
  add(all, "\x80\x02\x8a\x0al\xfc\x9c\x46\xf9 j\xa8P\x19."s);
  add(all, "\x80\x02M\xe9\x03."s);
  add(all, "\x80\x02}" + word("little_endian") + "\x88s.");
  add(all, pickle), add(all, "\x80\x02](" + keys + "e."), add(all, storages);
  return all;
}

Bytes counted(std::uint64_t count, const Bytes& content) {
  Bytes all;
  add(all, count, 8), add(all, content);
  return all;
}

Weights read(const Bytes& bytes) {
  const Folder folder;
  put(folder.path / "x.pth", bytes);
  return read_weights(folder.path / "x.pth");
}

Weights read(const std::string& pickle) { return read(zip_bytes(members(pickle))); }

std::string failure(const std::string& pickle) {
  return error_of([&] { read(pickle); });
}

std::string failure(Part part) { return failure(state_dict({{"a", part.tensor()}})); }

}  // namespace

TEST_CASE("torch files: a state dict in a zip file, whole tensors and parts of storages") {
  const Part number{"1", "LongStorage", 1, 0, {}, {}};
  const Weights found = read(state_dict({{"whole", Part{}.tensor()},
                                         {"turned", Part{.shape = {3, 2}, .strides = {1, 3}}.tensor()},
                                         {"column", Part{.offset = 2, .shape = {2}, .strides = {3}}.tensor()},
                                         {"empty", Part{.offset = 6, .shape = {0, 3}}.tensor()},
                                         {"batches", number.tensor()},
                                         {"epoch", "K\x05"}}));
  CHECK(found.tensors.size() == 5);
  CHECK(found.take("whole", {2, 3}) == kSix);
  CHECK(found.take("turned", {3, 2}) == std::vector<float>{1, 4, 2, 5, 3, 6});
  CHECK(found.take("column", {2}) == std::vector<float>{3, 6});
  CHECK(found.tensors.at("empty").data.empty());
  CHECK(found.tensors.at("batches").dtype == "I64");
  CHECK(found.tensors.at("batches").data == NamedTensor{"", {}, {std::byte{7}, {}, {}, {}, {}, {}, {}, {}}}.data);
}

TEST_CASE("torch files: a pickle by Python's own writer, for a state dict of two tensors in one storage") {
  static constexpr char kPickle[] =
      "\200\002ccollections\nOrderedDict\nq\000)Rq\001(X\013\000\000\000lin0.weightq\002ctorch._utils\n_rebu"
      "ild_tensor_v2\nq\003((X\007\000\000\000storageq\004ctorch\nFloatStorage\nq\005X\001\000\000\0000q\006"
      "X\003\000\000\000cpuq\007K\006tq\010QK\000K\002K\003\206q\011K\003K\001\206q\n\211h\000)Rq\013tq\014R"
      "q\015X\013\000\000\000lin1.weightq\016h\003((h\004h\005h\006h\007K\006tq\017QK\004K\002\205q\020K\001"
      "\205q\021\211h\000)Rq\022tq\023Rq\024u}q\025X\011\000\000\000_metadataq\026h\000)Rq\027X\000\000\000\000"
      "q\030}q\031X\007\000\000\000versionq\032K\001sssb.";
  const std::string pickle(kPickle, sizeof kPickle - 1);
  for (const Weights& found : {read(pickle), read(old_file(pickle, word("0"), counted(6, raw(kSix))))}) {
    CHECK(found.tensors.size() == 2);
    CHECK(found.take("lin0.weight", {2, 3}) == kSix);
    CHECK(found.take("lin1.weight", {2}) == std::vector<float>{5, 6});
  }
}

TEST_CASE("torch files: the forms before 1.6, of functions, of states and of parameters") {
  const Part part{.key = "1234", .shape = {3, 2}, .strides = {2, 1}};
  const std::string old_tensor = name("torch", "FloatTensor") + ")\x81(" + part.place() + "tb";
  const std::string made = part.with(name("torch._utils", "_rebuild_tensor") + "(", "tR");
  const Bytes values = counted(6, raw(kSix));
  for (const std::string& tensor :
       {part.tensor(), made, old_tensor,
        name("torch._utils", "_rebuild_parameter") + "(" + made + "\x88" + name("collections", "OrderedDict") + ")RtR",
        name("torch.nn.parameter", "Parameter") + made + "\x85R(\x88\x89Ntb",
        name("torch.nn.parameter", "Parameter") + ")\x81(" + made + "\x88\x89Ntb",
        name("torch.nn.parameter", "Parameter") + ")\x81(" + part.place() + "tb"}) {
    const Weights found = read(old_file(state_dict({{"a.weight", tensor}}), word("1234"), values));
    CHECK(found.take("a.weight", {3, 2}) == kSix);
  }
  // Python 2's: texts of one byte a letter, and a dict made of a list of pairs.
  const std::string pairs = "\x80\x02" + name("collections", "OrderedDict") + "](](U\x01" + "a" + made + "ee\x85R.";
  CHECK(read(old_file(pairs, "U\x04" + "1234"s, values)).take("a", {3, 2}) == kSix);
}

TEST_CASE("torch files: places and sizes that do not fit are refused, naming the tensor") {
  CHECK(holds(failure(Part{.count = 7}), "data/0 has 24 bytes, its tensors speak of 28"));
  CHECK(holds(failure(Part{.type = "DoubleStorage"}), "its tensors speak of 48"));
  CHECK(holds(failure(Part{.shape = {3, 3}}), "a: [3,3] from value 0 on lies outside of its storage of 6 values"));
  CHECK(holds(failure(Part{.offset = 1}), "a: [2,3] from value 1 on lies outside"));
  CHECK(holds(failure(Part{.strides = {4, 1}}), "lies outside"));
  CHECK(holds(failure(Part{.offset = -1}), "from value -1 on lies outside"));
  CHECK(holds(failure(Part{.shape = {2, -3}}), "a: a size or stride of -3"));
  CHECK(holds(failure(Part{.strides = {-3, 1}}), "a: a size or stride of -3"));
  CHECK(holds(failure(Part{.shape = {2, 3, 1}}), "as many strides as sizes"));
  const std::int64_t huge = std::int64_t{1} << 62;
  CHECK(holds(failure(Part{.shape = {huge, huge}, .strides = {0, 0}}), "lies outside"));
  CHECK(holds(failure(Part{.shape = {2, 3}, .strides = {huge, huge}}), "lies outside"));
  CHECK(holds(failure(Part{.count = huge}), "a sound size"));
  CHECK(holds(failure(Part{.key = "7"}), "looked for a member data/7, found none"));
  CHECK(holds(failure(state_dict({{"a", Part{}.tensor()}, {"b", Part{.count = 5, .shape = {5}}.tensor()}})),
              "of two types or sizes"));
  std::vector<std::pair<std::string, std::string>>
      many;  // of one storage of 24 bytes: more than the file can be said to hold
  for (int i = 0; i < 3000; i++) many.push_back({std::to_string(i), "h\x05"});
  many[0].second = Part{}.tensor() + "q\x05";
  CHECK(read(state_dict(many)).tensors.size() == 3000);
  std::vector<float> more(6000);
  const std::string one = Part{.count = 6000, .shape = {6000}, .strides = {1}}.tensor();
  for (auto& item : many) item.second = "h\x05";
  many[0].second = one + "q\x05";
  CHECK(holds(error_of([&] { read(zip_bytes(members(state_dict(many), more))); }), "more than 4 times the file"));
}

TEST_CASE("torch files: what is no state dict or not of this machine's order is refused") {
  CHECK(holds(failure("\x80\x02K\x01."s), "looked for a dict of tensors"));
  CHECK(holds(failure(state_dict({{"a", Part{.type = "FloatTensor"}.tensor()}})), "a type of storage"));
  auto big = members(state_dict({{"a", Part{}.tensor()}}));
  big[1].content = bytes_of("big");
  CHECK(holds(error_of([&] { read(zip_bytes(big)); }), "big-endian"));
  const std::string state = state_dict({{"a", Part{}.tensor()}});
  const auto old_failure = [](const Bytes& bytes) { return error_of([&] { read(bytes); }); };
  CHECK(holds(old_failure(old_file(state, word("0"), counted(5, raw(kSix)))), "storage 0 has 5 values, its tensors"));
  CHECK(holds(old_failure(old_file(state, "", {})), "storage 0 is missing"));
  CHECK(holds(old_failure(old_file(state, word("9"), counted(6, raw(kSix)))), "no tensor has the storage 9"));
  CHECK(holds(old_failure(old_file(state, word("0"), counted(6, {1, 2}))), "in the middle of a storage"));
  const std::string view = "(" + word("storage") + name("torch", "FloatStorage") + word("0") + word("cpu") + whole(6) +
                           "(" + word("1") + "K\x01K\x02ttQ";
  CHECK(holds(failure("\x80\x02" + view + "."), "a storage of its own"));
}

TEST_CASE("torch files: hostile pickles run nothing") {
  const Folder folder;
  const fs::path canary = folder.path / "canary";
  for (const HostilePickle& pickle : hostile_pickles(canary.string())) {
    CAPTURE(pickle.name);
    const bool harmless = pickle.name == "a dict of numbers for a frame";  // and without a tensor
    CHECK((failure(pickle.bytes) == "no error") == harmless);
    CHECK(error_of([&] { read(old_file(pickle.bytes, word("0"), counted(6, raw(kSix)))); }) != "no error");
    CHECK_FALSE(fs::exists(canary));
  }
  const std::string touch = "touch " + canary.string();
  CHECK(holds(failure(state_dict({{"a", name("os", "system") + word(touch) + "\x85R"}})),
              "the pickle asks for \"os system\"; only a state_dict()"));
  CHECK(holds(failure(state_dict({{"a", name("torch", "load") + word(touch) + "\x85R"}})), "asks for \"torch load\""));
  CHECK(holds(failure(state_dict({{"a", name("numpy", "ndarray")}})), "asks for \"numpy ndarray\""));
  // A parameter whose state holds it.
  const std::string circle = name("torch.nn.parameter", "Parameter") + ")\x81q\x07(h\x07\x88\x89tb";
  CHECK(read(state_dict({{"a", circle}})).tensors.empty());
}

TEST_CASE("torch files: cut anywhere or with a byte changed, they give an error of the data or the same values") {
  const std::string state = state_dict({{"a", Part{}.tensor()}});
  const std::vector<Bytes> files = {zip_bytes(members(state)), old_file(state, word("0"), counted(6, raw(kSix)))};
  for (const Bytes& all : files) {
    for (std::size_t length = 0; length < all.size(); length += 3)
      CHECK(error_of([&] { read(Bytes(all.begin(), all.begin() + std::ptrdiff_t(length))); }) != "no error");
    for (std::size_t at = 0; at < all.size(); at++) {
      Bytes changed = all;
      changed[at] ^= 0x15;
      error_of([&] { read(changed); });  // another fault than the data's fails
    }
  }
}

TEST_CASE("SHA-256: published values, whatever the parts") {
  const auto digest = [](const Bytes& bytes, std::size_t part) {
    Sha256 sum;
    for (std::size_t at = 0; at < bytes.size(); at += part)
      sum.add(std::span(bytes).subspan(at, std::min(part, bytes.size() - at)));
    return sum.digits();
  };
  // FIPS 180-4's examples; others by another program.
  CHECK(digest({}, 1) == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  CHECK(digest({'a', 'b', 'c'}, 2) == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  CHECK(digest(Bytes(1000000, 'a'), 777) == "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
  const auto counting = [](int count) {
    Bytes bytes;
    for (int i = 0; i < count; i++) bytes.push_back(static_cast<std::uint8_t>(7 * i + 3));
    return bytes;
  };
  CHECK(digest(counting(55), 9) == "e7313d333c272e639f790978283f9eb392e843d0f29b7016828bb1daa4aac70b");
  CHECK(digest(counting(56), 56) == "4324d65f3c103567f5589c710bc08f8523f929a9272e3af36fc968e52abc6c27");
  CHECK(digest(counting(63), 1) == "81c80242132f230c3bd41b3e63bbcff16107339549214a99614ff26664625055");
  CHECK(digest(counting(64), 64) == "39e3d7b6b5d075d37d053ad89b24b41bef4f3c29760c84447cab3f3be1882241");
  CHECK(digest(counting(65), 65) == "aacca6ff74fdbb296d165a45cecfa04e5127bc008770fbbdd48006f2d2fae95e");
  CHECK(digest(counting(119), 64) == "9ce7368e4daf32341631b492e80359dc9f594b48453cd0dd5bf0b19279cc177e");
  CHECK(digest(counting(200), 130) == "2c7e18c942ef065b526a2d4e5546283749cd3ddfb51d8fc71f42717363685f46");
  const Folder folder;
  put(folder.path / "x", Bytes(1000000, 'a'));
  CHECK(sha256_of_file(folder.path / "x") == digest(Bytes(1000000, 'a'), 1000000));
  put(folder.path / "x", Bytes(std::size_t{2} << 20, 'b'));  // two whole parts
  CHECK(sha256_of_file(folder.path / "x") == digest(Bytes(std::size_t{2} << 20, 'b'), 1 << 20));
  CHECK(holds(error_of([&] { sha256_of_file(folder.path / "none"); }), "no such file"));
}

TEST_CASE("published weights are known by the checksum of the file, each for its network") {
  const Bytes file = zip_bytes(members(state_dict({{"a", Part{}.tensor()}})));
  Sha256 sum;
  sum.add(file);
  CHECK(read(file).sha256 == sum.digits());
  CHECK(known_weights().size() == 5);
  for (const KnownWeights& known : known_weights()) {
    CAPTURE(known.file);
    CHECK(known.sha256.size() == 64);
    CHECK(known.sha256.find_first_not_of("0123456789abcdef") == std::string_view::npos);
    const auto dash = known.file.rfind('-');  // PyTorch's hub: the first eight digits end the name
    if (dash != std::string_view::npos)
      CHECK(known.file.substr(dash + 1) == std::string(known.sha256.substr(0, 8)) + ".pth");
    CHECK(is_published(known.network, known.sha256));
    CHECK_FALSE(is_published("squeezenet-1.0", known.sha256));
    CHECK_FALSE(is_published(known.network, known.sha256.substr(0, 63)));
    CHECK_FALSE(is_published(known.network, ""));
  }
  CHECK_FALSE(is_published(kAlexNet, known_weights()[0].sha256));
  CHECK(name_by_weights(kInception, true) == "inception-v3-2015-12-05");
  CHECK(name_by_weights(kInception, false) == "inception-v3-2015-12-05, unverified weights");
}
