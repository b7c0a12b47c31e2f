// See failure.h.
#include "cli/failure.h"

#include <exception>
#include <new>
#include <stdexcept>

namespace cloam {
namespace {

Error bug(const std::string& what) {
  return {Fault::internal,
          text("internal error: ", what, "\n  please report this with the command and the output of cloam info")};
}

}  // namespace

Error current_error() {
  try {
    throw;
  } catch (const Error& error) { return error; } catch (const std::bad_alloc&) {
    return {Fault::memory, "out of memory; a larger --downscale needs less"};
  } catch (const std::length_error&) {
    return {Fault::memory, "a size is larger than any memory; use smaller sizes in the settings or the data"};
  } catch (const std::exception& error) { return bug(error.what()); } catch (...) {
    return bug("something that is no exception was thrown");
  }
}

}  // namespace cloam
