#include "hal/sim/camera_fault.hpp"

#include <algorithm>
#include <array>
#include <fstream>
#include <sstream>

#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr std::array<const char*, 8> kKinds{"none", "absent", "out_of_memory", "unplugged",
                                            "lost", "black",  "frozen",        "not_applied"};

}  // namespace

SimCameraFault parse_camera_fault(const std::string& text, const std::string& where) {
  std::istringstream in(text);
  std::string kind;
  if (!(in >> kind)) return {};
  const auto* const found = std::find(kKinds.begin(), kKinds.end(), kind);
  SimCameraFault fault;
  std::string rest;
  if (found == kKinds.end()) {
    throw InputError(where, "a camera has no fault '" + kind.substr(0, 40) + "'",
                     "none, absent, out_of_memory, unplugged, lost, black, frozen or not_applied");
  }
  fault.kind = static_cast<SimCameraFault::Kind>(found - kKinds.begin());
  if (!(in >> fault.frame)) {
    if (!in.eof()) throw InputError(where, "the frame is no number", "0 or more");
    fault.frame = 0;
    return fault;
  }
  if (fault.frame < 0 || in >> rest) throw InputError(where, "more than KIND FRAME", "frozen 3");
  return fault;
}

SimCameraFault read_camera_fault(const std::filesystem::path& file) {
  if (file.empty()) return {};
  std::ifstream in(file);
  if (!in) return {};
  std::string line;
  std::getline(in, line);
  return parse_camera_fault(line, file.string());
}

}  // namespace brdfgate
