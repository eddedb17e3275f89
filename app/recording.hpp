// Recordings on disk: raw counts as 16-bit PNG and recording.yaml (cli.md, "Recording").
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "model/frame.hpp"

namespace brdfgate {

enum class RecordingRole { part, white, dark, ptc, board, mirror, black, chart };

struct Recording {
  std::string name;  ///< the folder's
  RecordingRole role = RecordingRole::part;
  std::string station_hash;
  std::string calibration_hash;  ///< may be empty
  Capture capture;
};

/// Throws InputError naming the file and field: schema, sizes that differ, a missing or foreign
/// PNG, counts beyond the ADC's bits, exposure not positive.
Recording read_recording(const std::filesystem::path& dir);
/// Atomic: written beside, then renamed; an existing folder of that name is an InputError.
void write_recording(const std::filesystem::path& dir, const Recording& recording);
/// The recordings under a path: itself, or its subfolders with a recording.yaml, sorted by name.
/// Throws InputError when there is none.
std::vector<std::filesystem::path> find_recordings(const std::filesystem::path& dir);

}  // namespace brdfgate
