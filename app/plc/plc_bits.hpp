// Names for the numbers of the PLC's register map (config/modbus_map.csv).
#pragma once

#include <cstdint>

namespace brdfgate {

inline constexpr std::uint32_t kMapMagic = 0x42524446;  ///< "BRDF"
inline constexpr std::uint16_t kMapVersion = 0x0100;    ///< 1.0
inline constexpr std::uint32_t kMapWordCheck = 0x01020304;
inline constexpr int kPublishedWeights = 8;  ///< per channel
inline constexpr int kPublishedChannels = 3;

/// Register `state`; the names of OPC 40100-1.
enum class StationState : std::uint16_t {
  preoperational = 0,
  halted = 1,
  error = 2,
  initialized = 3,
  ready = 4,
  inspecting = 5,  ///< made by the gate while busy
};

namespace status_bit {
inline constexpr std::uint16_t kReady = 1u << 0;
inline constexpr std::uint16_t kBusy = 1u << 1;
inline constexpr std::uint16_t kTriggerAck = 1u << 2;
inline constexpr std::uint16_t kAcquisitionDone = 1u << 3;
inline constexpr std::uint16_t kResultValid = 1u << 4;
inline constexpr std::uint16_t kPass = 1u << 5;
inline constexpr std::uint16_t kReject = 1u << 6;
inline constexpr std::uint16_t kNotJudged = 1u << 7;
inline constexpr std::uint16_t kError = 1u << 8;
inline constexpr std::uint16_t kWarning = 1u << 9;
inline constexpr std::uint16_t kMissedTrigger = 1u << 10;
inline constexpr std::uint16_t kCalibrationDue = 1u << 11;
inline constexpr std::uint16_t kSimulated = 1u << 12;
inline constexpr std::uint16_t kTimeValid = 1u << 13;
}  // namespace status_bit

namespace command_bit {
inline constexpr std::uint16_t kTriggerEnable = 1u << 0;
inline constexpr std::uint16_t kTrigger = 1u << 1;
inline constexpr std::uint16_t kResultAck = 1u << 2;
inline constexpr std::uint16_t kClearError = 1u << 3;
inline constexpr std::uint16_t kRecipeSelect = 1u << 4;
inline constexpr std::uint16_t kAll = 0x001F;
}  // namespace command_bit

namespace warning_bit {
inline constexpr std::uint16_t kDisk = 1u << 0;
inline constexpr std::uint16_t kAmbient = 1u << 1;
inline constexpr std::uint16_t kLampDrift = 1u << 2;
inline constexpr std::uint16_t kTilt = 1u << 3;
inline constexpr std::uint16_t kRecalibrationDue = 1u << 4;
inline constexpr std::uint16_t kClipped = 1u << 5;
inline constexpr std::uint16_t kSlowCycle = 1u << 6;
inline constexpr std::uint16_t kClock = 1u << 7;
inline constexpr std::uint16_t kSecondWriter = 1u << 8;
}  // namespace warning_bit

/// Register `result_state`.
enum class ResultState : std::uint16_t {
  undefined = 0,
  completed = 1,
  processing = 2,
  aborted = 3,
  failed = 4,
};

/// Register `error_code`; the manual's list.
enum class ErrorCode : std::uint16_t {
  none = 0,
  configuration = 1,     ///< the station cannot work as configured
  camera = 10,           ///< no frame in time, or none that could be used
  lights = 11,           ///< a light cannot be switched
  trigger_line = 12,     ///< the hardware trigger cannot be read
  camera_absent = 13,    ///< not there, not ours, or with another format than configured
  camera_settings = 14,  ///< an exposure or gain cannot be or is not applied
  camera_memory = 15,    ///< no memory for the camera's buffers
  camera_frames = 16,    ///< frames contradict each other: frozen, black, wrongly exposed
  calibration = 20,      ///< missing, foreign or unreadable
  basis = 21,            ///< missing or unreadable
  recipe = 22,           ///< foreign or unreadable
  processing = 30,       ///< the inspection itself failed
  storage = 40,          ///< the state directory cannot be written
  plc_heartbeat = 50,    ///< the PLC's heartbeat stands still
};

namespace valid_bit {
inline constexpr std::uint16_t kPresent = 1u << 0;
inline constexpr std::uint16_t kWeights = 1u << 1;
inline constexpr std::uint16_t kHighlight = 1u << 2;
inline constexpr std::uint16_t kGloss = 1u << 3;
inline constexpr std::uint16_t kColour = 1u << 4;
inline constexpr std::uint16_t kMeasured = 1u << 5;
}  // namespace valid_bit

}  // namespace brdfgate
