// The camera contract on the camera of a station file: what tests/unit/hal runs on made-up drivers,
// on a real kernel's devices.
//
//   camera_contract STATION.yaml [Catch2's options]
//
// BRDFGATE_UNPLUG and BRDFGATE_REPLUG, where both are set, are shell commands that take the device
// away and bring it back; BRDFGATE_CYCLES is the number of the leak test's cycles (100).
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#if __has_include(<catch2/catch_all.hpp>)
#include "catch.hpp"
#else
#define CATCH_CONFIG_RUNNER
#include "catch.hpp"
#endif
#include "app/open_camera.hpp"
#include "app/station.hpp"
#include "model/error.hpp"
#include "unit/hal/camera_contract.hpp"

using namespace brdfgate;
using namespace brdfgate::test;

namespace {

StationConfig& station() {
  static StationConfig config;
  return config;
}

/// Descriptors and shared mappings of devices that this process holds.
int held() {
  const auto fds = std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {});
  std::ifstream maps("/proc/self/maps");
  int mapped = 0;
  for (std::string line; std::getline(maps, line);)
    mapped += line.find("/dev/") != std::string::npos ? 1 : 0;
  return static_cast<int>(fds) + mapped;
}

std::function<void()> command_of(const char* variable) {
  const char* command = std::getenv(variable);
  if (command == nullptr) return {};
  return [text = std::string(command)] {
    if (std::system(text.c_str()) != 0) throw std::runtime_error("failed: " + text);
  };
}

CameraUnderTest camera_under_test() {
  const CameraConfig& config = station().camera;
  CameraUnderTest t;
  if (config.backend == CameraBackend::simulated) {
    const std::shared_ptr<Station> bench = open_station(station());
    bench->next_part(0);
    t.owner = bench;
    t.camera = &bench->camera();
  } else {
    const std::shared_ptr<Camera> camera = open_camera(config);
    t.owner = camera;
    t.camera = camera.get();
  }
  const auto& bracket = config.bracket_ms;
  t.exposures_s = {bracket.front() / 1e3, bracket[bracket.size() / 2] / 1e3, bracket.back() / 1e3};
  if (const auto fixed = config.device.fixed_exposure_s) t.exposures_s.fill(*fixed);
  t.timeout = std::chrono::milliseconds(static_cast<long>(config.frame_timeout_ms));
  t.held = held;
  const char* cycles = std::getenv("BRDFGATE_CYCLES");
  t.cycles = cycles != nullptr ? std::stoi(cycles) : 100;
  t.unplug = command_of("BRDFGATE_UNPLUG");
  t.replug = command_of("BRDFGATE_REPLUG");
  if (!t.replug) t.unplug = {};
  return t;
}

}  // namespace

TEST_CASE("The station's camera keeps the camera's contract") {
  check_camera_contract(camera_under_test);
}

int main(int argc, char* argv[]) {
  if (argc < 2) {
    std::fputs("usage: camera_contract STATION.yaml [Catch2's options]\n", stderr);
    return 2;
  }
  try {
    station() = read_station_config(argv[1]);
  } catch (const InputError& error) {
    std::fprintf(stderr, "camera_contract: %s\n", error.what());
    return 2;
  }
  argv[1] = argv[0];
  return Catch::Session().run(argc - 1, argv + 1);
}
