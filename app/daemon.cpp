#include "app/daemon.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <ctime>

#include "app/calibration_work.hpp"
#include "app/device_faults.hpp"
#include "app/plc/device.hpp"
#include "app/recipe_file.hpp"
#include "app/session.hpp"
#include "app/utc_time.hpp"
#include "config/register_map.hpp"
#include "hal/gpio/gpio_trigger.hpp"
#include "model/error.hpp"
#include "model/hash.hpp"
#include "model/mapped_file.hpp"
#include "model/reference_upkeep.hpp"

namespace brdfgate {
namespace {

using namespace std::chrono_literals;

/// How often the gate's clockwork is looked at; the heartbeat's period is 100 ms.
constexpr auto kTick = 50ms;
constexpr auto kStoreEvery = 5s;
constexpr auto kCheckDevicesEvery = 1s;
/// Warn from this share of a limit on.
constexpr double kWarnShare = 0.5;
/// A clock before this build's year was never set.
constexpr std::time_t kClockValidFrom = 1767225600;  // 2026-01-01

bool clock_valid() {
  return std::time(nullptr) >= kClockValidFrom;
}

std::chrono::milliseconds seconds(double s) {
  return std::chrono::milliseconds(static_cast<long>(1000 * s));
}

TcpServerSettings server_settings(const PlcConfig& plc) {
  TcpServerSettings settings;
  settings.bind = plc.tcp.bind;
  settings.port = plc.tcp.port;
  settings.allow = plc.tcp.allow;
  settings.max_clients = plc.tcp.max_clients;
  settings.request_deadline =
      std::chrono::milliseconds(static_cast<long>(plc.tcp.request_deadline_ms));
  settings.idle_timeout = seconds(plc.tcp.idle_timeout_s);
  settings.unit_id = static_cast<std::uint8_t>(plc.unit_id);
  settings.device = device_identification();
  return settings;
}

std::unique_ptr<VerdictLines> open_verdict_lines(const StationConfig& config) {
  return config.outputs ? std::make_unique<VerdictLines>(*config.outputs) : nullptr;
}

}  // namespace

PlcGateSettings Daemon::gate_settings() {
  const PlcConfig& plc = config_.plc;
  PlcGateSettings settings;
  settings.word_order = plc.word_order;
  settings.handshake_timeout = seconds(plc.handshake_timeout_s);
  settings.plc_heartbeat_timeout = seconds(plc.heartbeat_timeout_s);
  settings.owner_silence = std::min(settings.owner_silence, seconds(plc.tcp.idle_timeout_s));
  settings.note = [](const std::string& text) { spdlog::warn("{}", text); };
  settings.without_plc = config_.trigger && !config_.trigger->needs_enable;
  if (verdict_lines_) {
    settings.show = [lines = verdict_lines_.get()](const GpioOutputState& state) {
      lines->show(state);
    };
  }
  return settings;
}

Daemon::Daemon(const StationConfig& config, const std::filesystem::path& evidence_dir)
    : config_(config),
      inspector_(load_inspector(config)),
      counter_file_(config.files.state_dir),
      verdict_lines_(open_verdict_lines(config)),
      gate_(RegisterMap::built_in(), gate_settings(), counter_file_.at_start()),
      station_(open_station(config)) {
  if (!counter_file_.warning().empty()) spdlog::warn("{}", counter_file_.warning());
  load_recipes();
  if (!evidence_dir.empty()) evidence_ = std::make_unique<EvidenceWriter>(evidence_dir, inspector_);
  cycle_ = std::make_unique<InspectionCycle>(
      *station_, inspector_, gate_, marks_, config_.camera,
      [this](const Inspection& part, const auto& published) { observe(part, published); });
  if (in_force_ != nullptr) cycle_->use(&in_force_->in_force);
  announce(StationState::initialized);
  if (config.plc.tcp.enabled)
    server_ = std::make_unique<TcpServer>(server_settings(config.plc), gate_, gate_);
  watch_trigger_line();
  housekeeper_ = std::jthread([this](const std::stop_token& stop) { keep_house(stop); });
}

Daemon::~Daemon() {
  trigger_watch_.reset();
  announce(StationState::halted);
  station_->lights().all_off();
  housekeeper_.request_stop();
  housekeeper_.join();
}

void Daemon::load_recipes() {
  for (const auto& file : config_.files.recipes) {
    Recipe recipe = read_recipe(file);
    const auto id = static_cast<std::uint16_t>(recipe.id);
    if (recipes_.count(id) != 0) {
      throw InputError(file.string(), "id " + std::to_string(id) + " is taken by another recipe",
                       "unique ids");
    }
    recipes_.emplace(id, LoadedRecipe{inspector_.bring_into_force(std::move(recipe)),
                                      sha256_hex(MappedFile(file).bytes())});
    if (in_force_ == nullptr) in_force_ = &recipes_.at(id);
  }
  std::vector<std::uint16_t> ids;
  for (const auto& [id, recipe] : recipes_)
    ids.push_back(id);
  gate_.set_recipes(std::move(ids));
}

void Daemon::choose_recipe(std::uint16_t id) {
  in_force_ = &recipes_.at(id);
  cycle_->use(&in_force_->in_force);
  announce(StationState::ready);
  spdlog::info("recipe {} '{}' is in force", id, in_force_->in_force.recipe.name);
}

CalibrationAge Daemon::calibration_age() {
  CalibrationAge age;
  age.grace_days = config_.upkeep.grace_days;
  if (!clock_valid()) return age;
  age.days_until_due = days_until_due(inspector_.calibration(), config_.upkeep.max_age_days,
                                      utc_now().substr(0, 10));
  if (age.due() && !due_told_) {
    due_told_ = true;
    spdlog::warn("the calibration was due {} days ago; parts are judged until {} days after",
                 -*age.days_until_due, age.grace_days);
  }
  return age;
}

void Daemon::announce(StationState state) {
  const bool due = calibration_age().due();
  StationStatus status;
  trigger_lost_announced_ = trigger_lost_;
  status.error_code = trigger_lost_announced_ ? ErrorCode::trigger_line : device_error_;
  status.state = status.error_code == ErrorCode::none ? state : StationState::error;
  status.warning_bits = static_cast<std::uint16_t>(due ? warnings_ | warning_bit::kRecalibrationDue
                                                       : warnings_.load());
  status.calibration_due = due;
  announced_due_ = due;
  status.recipe_id =
      in_force_ != nullptr ? static_cast<std::uint16_t>(in_force_->in_force.recipe.id) : 0;
  status.clusters = in_force_ != nullptr
                        ? static_cast<std::uint16_t>(in_force_->in_force.recipe.clusters.size())
                        : 0;
  status.components = static_cast<std::uint16_t>(inspector_.basis().info().components);
  status.channels = static_cast<std::uint16_t>(inspector_.calibration().sensor.channels());
  status.config_hash = config_.hash;
  status.simulated = station_->simulated();
  status.time_valid = clock_valid();
  gate_.set_station(status);
}

void Daemon::observe(const Inspection& part, const std::optional<PublishedTimes>& published) {
  std::uint16_t bits = warnings_ & warning_bit::kDisk;
  if (part.result.ambient > kWarnShare * config_.judge.max_ambient) bits |= warning_bit::kAmbient;
  if (part.result.clipped > kWarnShare * config_.judge.max_clipped) bits |= warning_bit::kClipped;
  for (const double drift : part.facts.lamp_drift) {
    if (!(std::abs(drift) <= kWarnShare * part.facts.max_lamp_drift))
      bits |= warning_bit::kLampDrift;
  }
  if (bits != warnings_) {
    warnings_ = bits;
    announce(StationState::ready);
  }
  if (evidence_ == nullptr || !published) return;
  evidence_->offer(as_published(part, published->verdict),
                   {.recipe = in_force_ != nullptr ? &in_force_->in_force : nullptr,
                    .name = "part " + std::to_string(published->trigger_id),
                    .station_hash = config_.station_hash,
                    .recipe_hash = in_force_ != nullptr ? in_force_->hash : "",
                    .times = {static_cast<double>(published->acquisition_ms),
                              static_cast<double>(published->processing_ms)}});
}

/// A station that cannot see its trigger would let parts pass: it is in error until the line is
/// back.
void Daemon::watch_trigger_line() {
  if (!config_.trigger) return;
  TriggerWatch::Told told;
  told.fired = [this] {
    if (!gate_.external_trigger()) spdlog::warn("trigger line: not ready, the trigger was missed");
  };
  told.lost = [this](bool lost) {
    trigger_lost_ = lost;
    gate_.wake();
  };
  trigger_watch_ = std::make_unique<TriggerWatch>(
      [gpio = config_.trigger->gpio] { return std::make_unique<GpioTrigger>(gpio); }, told);
}

/// A camera that is away, at the start or later, is an error of the station until it is back.
void Daemon::check_devices() {
  next_device_check_ = std::chrono::steady_clock::now() + kCheckDevicesEvery;
  ErrorCode found = ErrorCode::none;
  try {
    station_->check();
  } catch (const DeviceError& error) {
    const DeviceFault fault = fault_of(error);
    found = fault.code;
    device_faults_.report(fault.fault_class, error.what());
  } catch (const InputError& error) {
    found = ErrorCode::configuration;
    device_faults_.report("devices", error.what());
  }
  if (found == device_error_) return;
  if (found == ErrorCode::none) spdlog::info("devices: usable again");
  device_error_ = found;
  announce(StationState::ready);
}

void Daemon::run(const std::stop_token& stop) {
  const std::stop_callback wake(stop, [this] { gate_.wake(); });
  check_devices();
  announce(StationState::ready);
  notify_ready();
  while (!stop.stop_requested()) {
    if (std::chrono::steady_clock::now() >= next_device_check_) check_devices();
    if (trigger_lost_ != trigger_lost_announced_) announce(StationState::ready);
    ++marks_.capture;
    ++marks_.judging;
    const PlcCommand command = gate_.wait_for_command(100ms);
    if (const auto* trigger = std::get_if<TriggerAccepted>(&command)) {
      const CalibrationAge age = calibration_age();
      cycle_->use(age);
      // The day may have changed since the last announcement.
      if (age.due() != announced_due_) announce(StationState::ready);
      cycle_->run(trigger->trigger_id);
      // After the result, and before the PLC has acknowledged it.
      check_devices();
    }
    if (const auto* selected = std::get_if<RecipeSelected>(&command))
      choose_recipe(selected->recipe);
    if (std::holds_alternative<ErrorCleared>(command)) announce(StationState::ready);
  }
}

void Daemon::keep_house(const std::stop_token& stop) {
  std::mutex unused;
  std::condition_variable_any pause;
  SteadyTime next_store = std::chrono::steady_clock::now() + kStoreEvery;
  FaultLog faults;
  ServiceWatchdog watchdog;
  while (!stop.stop_requested()) {
    const SteadyTime now = std::chrono::steady_clock::now();
    const TickReport report = gate_.tick(now, {marks_.capture, marks_.judging});
    watchdog.alive(now, marks_.capture + marks_.judging);
    if (report.handshake_released)
      faults.report("handshake", "the PLC did not acknowledge; released");
    if (report.plc_heartbeat_lost) faults.report("PLC heartbeat", "stands still");
    if (now >= next_store || stop.stop_requested()) {
      next_store = now + kStoreEvery;
      try {
        counter_file_.store(gate_.counters());
      } catch (const InputError& error) {
        warnings_ |= warning_bit::kDisk;
        faults.report("state directory", error.what());
      }
    }
    std::unique_lock lock(unused);
    pause.wait_for(lock, stop, kTick, [] { return false; });
  }
  try {
    counter_file_.store(gate_.counters());
  } catch (const InputError& error) {
    faults.report("state directory", error.what());
  }
}

}  // namespace brdfgate
