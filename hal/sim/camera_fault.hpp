// Faults of the simulated camera, to see what a station makes of them.
#pragma once

#include <filesystem>
#include <string>

namespace brdfgate {

struct SimCameraFault {
  enum class Kind {
    none,
    absent,         ///< not there
    out_of_memory,  ///< there, without memory for its buffers
    unplugged,      ///< goes away at `frame`
    lost,           ///< no frame comes from `frame` on
    black,          ///< `frame` is black
    frozen,         ///< from `frame` on always the same picture
    not_applied,    ///< from `frame` on the exposure stays what it was, and is reported otherwise
  };
  Kind kind = Kind::none;
  int frame = 0;  ///< of a part, from 0, those without light first
  bool operator==(const SimCameraFault&) const = default;
};

/// "KIND [FRAME]", as in "frozen 3"; an empty text: none. Throws InputError naming `where`.
SimCameraFault parse_camera_fault(const std::string& text, const std::string& where);

/// What the file says now; a missing one, and no file, says none. Throws InputError.
SimCameraFault read_camera_fault(const std::filesystem::path& file);

}  // namespace brdfgate
