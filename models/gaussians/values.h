// What the files of gaussians share: activations and their inverses, rounding, memory for a number that a file names.
#pragma once
#include <cstdint>
#include <string>

#include "models/gaussians/gaussians.h"

namespace cloam {

double sigmoid(double logit);

/// The inverse of sigmoid. Files hold 0 and 1, which have no logit: they stand for what rounds to them, so the opacity
/// is taken from [least, 1 - least].
float logit(double opacity, double least);

/// The logarithm of a deviation; 0 stands for the least float above it. NaN where it is negative.
float log_scale(double deviation);

/// Rounded, the nearest of 0 to 255.
std::uint8_t to_byte(double value);

/// What a byte of opacity stands for, as a logit, and back.
float logit_of_byte(std::uint8_t opacity);
std::uint8_t byte_of_logit(float opacity);

/// Fault::data, with `file` at its head, for more than 64 million, which no device holds: files with few bytes a
/// gaussian could ask for 80 times their own size.
void check_count(std::uint64_t count, const std::string& file);

/// All zeros. Errors as check_count.
Gaussians zero_gaussians(std::uint64_t count, const std::string& file);

/// Adds the gaussians of `more` behind those of `all`.
void append(Gaussians& all, const Gaussians& more);

/// The least degree (0 to 3) that holds all coefficients. Negative zeros count: they are bits to be kept.
int degree_of(const Gaussians& gaussians);
/// Without the first: 0, 3, 8, 15.
constexpr std::size_t rest_of_degree(int degree) { return static_cast<std::size_t>((degree + 1) * (degree + 1) - 1); }

/// Removes gaussians with values that are not finite, a deviation beyond float, or a rotation of length 0; how many.
std::size_t drop_unsound(Gaussians& gaussians);

}  // namespace cloam
