// Wrong calls: each message names the op, what it got and what it wants.
#include <doctest/doctest.h>

#include <functional>

#include "runtime/error.h"
#include "runtime/ops.h"

using namespace cloam;

namespace {

Tensor made(const Shape& shape) { return zeros(shape); }
Tensor whole(const Shape& shape) { return cast(zeros(shape), DType::i32); }

struct Wrong {
  const char* what;
  std::function<void()> call;
  std::vector<std::string> says;
};

void check_messages(const std::vector<Wrong>& calls) {
  for (const Wrong& wrong : calls) {
    CAPTURE(wrong.what);
    std::string said = "nothing was thrown";
    try {
      wrong.call();
    } catch (const Error& error) {
      CHECK(error.fault() == Fault::internal);
      said = error.what();
    }
    CAPTURE(said);
    for (const std::string& part : wrong.says) CHECK_MESSAGE(said.find(part) != std::string::npos, part);
  }
}

}  // namespace

TEST_CASE("pointwise ops say which axes do not meet") {
  check_messages({
      {"add",
       [] {
         made({2, 3}) + made({4});
       },
       {"[add]", "[2,3]", "[4]", "3 against 4 on axis -1"}},
      {"atan2",
       [] {
         atan2(made({2, 3}), made({3, 3}));
       },
       {"[atan2]", "2 against 3 on axis -2"}},
      {"where", [] { where(made({2}), made({2}), made({2})); }, {"[where]", "float32", "integer mask"}},
      {"modulo", [] { modulo(whole({2}), made({2})); }, {"[modulo]", "integers", "float32"}},
      {"bit_xor", [] { bit_xor(cast(made({2}), DType::f16), whole({2})); }, {"[bit_xor]", "integers", "float16"}},
      {"clamp", [] { clamp(made({2}), made({3}), made({2})); }, {"[2]", "[3]"}},
  });
}

TEST_CASE("views say what does not fit") {
  check_messages({
      {"reshape",
       [] {
         reshape(made({2, 3}), {4, 2});
       },
       {"[reshape]", "[2,3]", "6 elements", "[4,2]", "8"}},
      {"reshape -1",
       [] {
         reshape(made({2, 3}), {4, -1});
       },
       {"[reshape]", "[2,3]"}},
      {"permute",
       [] {
         permute(made({2, 3}), {0, 0});
       },
       {"[permute]", "[0,0]", "[2,3]"}},
      {"permute outside",
       [] {
         permute(made({2, 3}), {0, 2});
       },
       {"axis 2", "2 axes"}},
      {"permute from the back",
       [] {
         permute(made({2, 3}), {1, -1});
       },
       {"[permute]", "[1,-1]", "[2,3]"}},
      {"unsqueeze",
       [] {
         unsqueeze(made({2, 3}), 9);
       },
       {"[unsqueeze]", "axis 9 is outside"}},
      {"unsqueeze from the back",
       [] {
         unsqueeze(made({2, 3}), -4);
       },
       {"[unsqueeze]", "axis -4 is outside"}},
      {"negative", [] { zeros({-1}); }, {"[-1]", "negative extent"}},
      {"negative, broadcast",
       [] {
         broadcast_to(made({2, 3}), {-1, 2, 3});
       },
       {"[-1,2,3]", "negative extent"}},
      {"negative, random",
       [] {
         random_uniform({3, -2}, {1}).to_host();
       },
       {"[3,-2]", "negative extent"}},
      {"two that are to be found",
       [] {
         reshape(made({2, 3}), {-1, -1});
       },
       {"[-1,-1]", "negative extent"}},
      {"transpose",
       [] {
         transpose(made({2, 3}), 0, 5);
       },
       {"[transpose]", "axis 5"}},
      {"slice",
       [] {
         slice(made({2, 3}), 1, 2, 5);
       },
       {"[slice]", "2:5:1", "axis 1", "[2,3]"}},
      {"slice step",
       [] {
         slice(made({2, 3}), 1, 0, 2, 0);
       },
       {"[slice]", "0:2:0"}},
      {"broadcast_to",
       [] {
         broadcast_to(made({2, 3}), {2, 1});
       },
       {"[broadcast_to]", "[2,3]", "[2,1]"}},
      {"bitcast", [] { bitcast(made({2}), DType::u8); }, {"[bitcast]", "float32", "uint8"}},
      {"rank",
       [] {
         reshape(made({1}), {1, 1, 1, 1, 1, 1, 1, 1, 1});
       },
       {"8 axes"}},
  });
}

TEST_CASE("reductions and joins name the axis") {
  check_messages({
      {"sum",
       [] {
         sum(made({2, 3}), {{2}});
       },
       {"axis 2", "2 axes"}},
      {"softmax",
       [] {
         softmax(made({2, 3}), -3);
       },
       {"[softmax]", "axis -3"}},
      {"concat nothing", [] { concat({}, 0); }, {"[concat]"}},
      {"concat",
       [] {
         concat({made({2, 3}), made({2, 4})}, 0);
       },
       {"[concat]", "[2,4]", "[2,3]", "axis 0"}},
      {"concat dtypes",
       [] {
         concat({made({2}), whole({2})}, 0);
       },
       {"[concat]", "int32", "float32"}},
      {"split",
       [] {
         split(made({5}), 0, {2, 2});
       },
       {"[split]", "4", "5"}},
      {"pad", [] { pad(made({5}), 0, -1, 0); }, {"[pad]", "-1"}},
  });
}

TEST_CASE("dense ops say which sizes differ") {
  check_messages({
      {"matmul",
       [] {
         matmul(made({2, 3}), made({4, 5}));
       },
       {"[matmul]", "[2,3]", "[4,5]", "K is 3", "4 in b"}},
      {"matmul rank",
       [] {
         matmul(made({3}), made({3, 5}));
       },
       {"[matmul]", "[3]", "unsqueeze"}},
      {"matmul dtype",
       [] {
         matmul(whole({2, 3}), made({3, 5}));
       },
       {"[matmul]", "int32", "cast"}},
      {"conv2d",
       [] {
         conv2d(made({1, 3, 5, 5}), made({4, 2, 3, 3}));
       },
       {"[conv2d]", "[1,3,5,5]", "[4,2,3,3]", "C = 3"}},
      {"conv2d small",
       [] {
         conv2d(made({1, 3, 2, 2}), made({4, 3, 3, 3}));
       },
       {"[conv2d]", "3x3", "2x2"}},
      {"layer_norm",
       [] {
         layer_norm(made({2, 3}), made({4}), made({4}));
       },
       {"[layer_norm]", "[4]", "[2,3]", "want [3]"}},
      {"group_norm",
       [] {
         group_norm(made({2, 6, 3}), 4, made({6}), made({6}));
       },
       {"[group_norm]", "[2,6,3]", "4 groups"}},
      {"attention",
       [] {
         attention(made({1, 2, 4}), made({1, 3, 5}), made({1, 3, 6}));
       },
       {"[attention]", "k has shape [1,3,5]", "D is 4 in q but 5"}},
      {"resize",
       [] {
         resize_bilinear(made({1, 2, 3, 4}), 0, 5);
       },
       {"[resize_bilinear]", "[1,2,3,4]", "0x5"}},
      {"resize rank",
       [] {
         resize_nearest(made({2, 3, 4}), 2, 5);
       },
       {"[resize_nearest]", "[2,3,4]", "N C H W"}},
  });
}

TEST_CASE("moving values checks counts and types") {
  check_messages({
      {"from_host",
       [] {
         from_host(std::vector<float>{1, 2, 3}, {2, 2});
       },
       {"[from_host]", "3 values", "[2,2]"}},
      {"from_host, negative",
       [] {
         from_host(std::vector<float>{1, 2}, {-1, -2});
       },
       {"[-1,-2]", "negative extent"}},
      {"to_host", [] { made({2}).to_host<int32_t>(); }, {"[to_host]", "float32"}},
      {"item", [] { made({2}).item(); }, {"[item]", "[2]"}},
      {"grad", [] { grad(made({2}), {}); }, {"[grad]", "[2]", "sum or mean"}},
      {"no tensor", [] { (void)Tensor().shape(); }, {"[tensor]", "empty handle"}},
      {"no tensor's type", [] { (void)Tensor().dtype(); }, {"[tensor]", "empty handle"}},
      {"no tensor evaluated", [] { eval({Tensor()}); }, {"[tensor]", "empty handle"}},
      {"no tensor chooses", [] { where(Tensor(), made({2}), made({2})); }, {"[tensor]", "empty handle"}},
      {"no tensor in a product",
       [] {
         matmul(made({2, 3}), Tensor());
       },
       {"[tensor]", "empty handle"}},
      {"gather",
       [] {
         gather_rows(made({2, 3}), made({2}));
       },
       {"[gather_rows]", "float32", "int32"}},
  });
}
