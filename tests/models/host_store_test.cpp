// What the store on the host promises: values do not depend on it, its budget holds, what is announced is made ahead.
#include "models/io/host_store.h"

#include <doctest/doctest.h>

#include <atomic>
#include <chrono>
#include <stdexcept>

#include "models/io/in_parallel.h"

namespace cloam {
namespace {

/// Ten bytes each; the value says its number.
struct Numbers {
  explicit Numbers(uint64_t budget, int threads = 0) : store(std::make_shared<HostStore>(budget, threads)) {}
  Stored<std::size_t> list() {
    return {store, 100,
            [this](std::size_t number) {
              ++made;
              if (number == broken) throw std::runtime_error("broken");
              return number;
            },
            [](std::size_t) { return uint64_t{10}; }};
  }
  /// Of something that threads do.
  template <class Condition>
  static bool comes_true(const Condition& condition) {
    for (int i = 0; i < 2000 && !condition(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return condition();
  }

  std::shared_ptr<HostStore> store;
  std::atomic<int> made{0};
  std::size_t broken = ~std::size_t{0};
};

}  // namespace

TEST_CASE("a store holds what was used last, within its budget") {
  Numbers numbers(30);
  const Stored<std::size_t> list = numbers.list();
  for (const std::size_t number : {0, 1, 2, 0, 3}) CHECK(*list[number] == number);  // 3 takes the place of 1
  CHECK(numbers.made == 4);
  CHECK(numbers.store->use().held == 30);
  for (const std::size_t number : {0, 2, 3}) CHECK(*list[number] == number);
  CHECK(numbers.made == 4);
  CHECK(*list[1] == 1);
  CHECK(numbers.made == 5);
  CHECK(numbers.store->use().most_held == 30);
}

TEST_CASE("a store without room gives every value all the same, and a value outlives its place") {
  Numbers numbers(9);
  const Stored<std::size_t> list = numbers.list();
  for (int round = 0; round < 2; ++round)
    for (std::size_t number = 0; number < 3; ++number) CHECK(*list[number] == number);
  CHECK(numbers.made == 6);
  CHECK(numbers.store->use().held == 0);
  Numbers one(10);
  const Stored<std::size_t> other = one.list();
  const std::shared_ptr<const std::size_t> kept = other[7];
  CHECK(*other[8] == 8);
  CHECK(*kept == 7);
}

TEST_CASE("what is announced is made ahead as far as it fits, and stays until its moment has passed") {
  Numbers numbers(30, 2);
  const Stored<std::size_t> list = numbers.list();
  for (std::size_t number = 0; number < 5; ++number) list.want(number, 1 + static_cast<int64_t>(number));
  REQUIRE(Numbers::comes_true([&] { return numbers.store->use().held == 30; }));
  CHECK(numbers.made == 3);
  CHECK(*list[50] == 50);  // takes no place of what is announced
  CHECK(numbers.made == 4);
  for (const std::size_t number : {0, 1, 2}) CHECK(*list[number] == number);
  CHECK(numbers.made == 4);
  CHECK(numbers.store->use().waited == 1);
  list.begin(3);  // 0 and 1 may go: 3 and 4 come
  REQUIRE(Numbers::comes_true([&] { return numbers.made == 6; }));
  for (const std::size_t number : {2, 3, 4}) CHECK(*list[number] == number);
  CHECK(numbers.made == 6);
}

TEST_CASE("what cannot be made is told to whoever asks for it, each time, and to no one else") {
  Numbers numbers(100, 2);
  numbers.broken = 4;
  const Stored<std::size_t> list = numbers.list();
  for (std::size_t number = 3; number < 6; ++number) list.want(number, 1);
  REQUIRE(Numbers::comes_true([&] { return numbers.made == 3; }));
  CHECK(*list[3] == 3);
  CHECK_THROWS_AS((void)list[4], std::runtime_error);
  CHECK_THROWS_AS((void)list[4], std::runtime_error);
  CHECK(*list[5] == 5);
}

TEST_CASE("many threads ask a small store at once, and each gets what it asked for") {
  Numbers numbers(50, 3);
  const Stored<std::size_t> list = numbers.list();
  std::atomic<int> wrong{0};
  in_parallel(5000, [&](std::size_t i) {
    const std::size_t number = i * 37 % 100;
    list.want((number + 37) % 100, static_cast<int64_t>(i));
    list.begin(static_cast<int64_t>(i));
    wrong += *list[number] != number;
  });
  CHECK(wrong == 0);
  CHECK(numbers.store->use().most_held <= 50);
}

}  // namespace cloam
