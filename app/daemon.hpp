// brdfgated: composes station, inspector and PLC, and runs until it is told to stop.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <stop_token>

#include "app/evidence.hpp"
#include "app/inspection_cycle.hpp"
#include "app/inspector.hpp"
#include "app/machine_lines.hpp"
#include "app/plc/counters.hpp"
#include "app/plc/plc_gate.hpp"
#include "app/service_manager.hpp"
#include "app/station.hpp"
#include "config/station_config.hpp"
#include "hal/modbus/tcp_server.hpp"

namespace brdfgate {

/// Threads: the caller's runs inspections; the Modbus server has its own; one more ticks the gate
/// and stores counters; one draws pictures; one waits for the trigger line. All share the PlcGate,
/// which locks for itself.
class Daemon {
 public:
  /// Opens everything the configuration names. Throws InputError or DeviceError (port in use).
  Daemon(const StationConfig& config, const std::filesystem::path& evidence_dir);
  ~Daemon();

  int port() const { return server_ ? server_->port() : 0; }

  /// Serves commands until `stop` is requested.
  void run(const std::stop_token& stop);

 private:
  void load_recipes();
  void choose_recipe(std::uint16_t id);
  PlcGateSettings gate_settings();
  void announce(StationState state);
  void watch_trigger_line();
  void check_devices();
  /// Of the calibration today; nothing known while the clock is not set. Logs once when it is due.
  CalibrationAge calibration_age();
  void keep_house(const std::stop_token& stop);
  void observe(const Inspection& part, const std::optional<PublishedTimes>& published);

  const StationConfig config_;
  Inspector inspector_;
  struct LoadedRecipe {
    RecipeInForce in_force;
    std::string hash;  ///< SHA-256 of its file
  };
  std::map<std::uint16_t, LoadedRecipe> recipes_;
  const LoadedRecipe* in_force_ = nullptr;
  CounterFile counter_file_;
  std::unique_ptr<VerdictLines> verdict_lines_;
  PlcGate gate_;
  std::unique_ptr<Station> station_;
  CycleMarks marks_;
  std::unique_ptr<EvidenceWriter> evidence_;
  std::atomic<std::uint16_t> warnings_{0};
  std::atomic<bool> trigger_lost_{false};
  bool trigger_lost_announced_ = false;
  ErrorCode device_error_ = ErrorCode::none;
  SteadyTime next_device_check_{};
  FaultLog device_faults_;
  bool due_told_ = false, announced_due_ = false;
  std::unique_ptr<InspectionCycle> cycle_;
  std::unique_ptr<TcpServer> server_;
  std::unique_ptr<TriggerWatch> trigger_watch_;
  std::jthread housekeeper_;
};

}  // namespace brdfgate
