// The other side of the register map: a small PLC stand-in on libmodbus's client, for
// `brdfgate plc watch` and as an independent peer of our server in tests.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "app/plc/register_image.hpp"
#include "model/verdict.hpp"

// libmodbus's own name for its context.
// NOLINTNEXTLINE(bugprone-reserved-identifier,readability-identifier-naming)
struct _modbus;

namespace brdfgate {

/// One cluster block as read.
struct PlcCluster {
  int index = 0;
  std::uint16_t valid_bits = 0;
  std::uint32_t pixels = 0;  ///< in steps of 16
  double area_share = 0;
  double t2 = 0;
  double spe = 0;
  std::array<double, 3> gloss_gu{};
  std::array<double, 3> lab{};
  double delta_e00 = 0;
  double weight_uncertainty = 0;
  std::vector<double> weights;  ///< prior sigmas, channel by channel, 8 a channel
};

/// One result as a PLC reads it.
struct PlcPart {
  std::uint32_t sequence = 0;
  std::uint32_t trigger_id = 0;
  std::uint32_t result_id = 0;
  int result_state = 0;
  Verdict verdict = Verdict::none;
  ReasonBits reason_bits = 0;
  int worst_cluster = 0;
  double t2_ratio = 0;
  double spe_ratio = 0;
  std::array<double, 2> tilt_deg{};
  double ambient = 0;
  int defects = 0;
  int acquisition_ms = 0;
  int processing_ms = 0;
  int cycle_ms = 0;
  std::vector<PlcCluster> clusters;  ///< the present ones
};

/// The texts of a result's reason bits, as in the map.
std::vector<std::string> reasons_in_words(ReasonBits bits);

struct PlcClientSettings {
  std::string host = "127.0.0.1";  ///< name or address
  int port = 1502;
  int unit_id = 1;
  WordOrder word_order = WordOrder::abcd;
  std::chrono::milliseconds response_timeout{1000};
  std::chrono::milliseconds step_timeout{30000};  ///< for each step of the handshake
  std::chrono::milliseconds scan{2};              ///< pause between two looks at the status
};

/// Not for several threads. Every member throws InputError naming host, port and step: no
/// connection, no answer, an exception answer, a step that does not come in time.
class PlcClient {
 public:
  explicit PlcClient(PlcClientSettings settings);

  /// Station, counters and check blocks; throws when magic, version or the two checks are not what
  /// this map and word order say.
  const RegisterImage& read_station();
  /// Drops every command bit, then sets trigger_enable.
  void enable();
  /// Selects a recipe and waits until it is in force.
  void select_recipe(std::uint16_t recipe);
  /// The whole handshake for one part: ready, trigger, result, acknowledgement, trigger_ack low.
  PlcPart inspect(std::uint32_t trigger_id);
  /// Result block and cluster blocks, each in one read; read again while their sequence numbers
  /// differ.
  PlcPart read_result();
  /// Drops every command bit.
  void release();

  std::uint16_t status();
  void command(std::uint16_t bits);
  void write_trigger_id(std::uint32_t trigger_id);

 private:
  struct Free {
    void operator()(_modbus* handle) const;
  };
  void read(const RegisterRange& range);
  std::uint32_t read_one(std::string_view key);
  void write(int address, const std::vector<std::uint16_t>& words, const char* what);
  std::uint16_t wait_for(std::uint16_t bits, bool set, const char* what);
  template <class Condition>
  void wait_until(Condition condition, const char* what);
  PlcCluster cluster(int index) const;
  [[noreturn]] void fail(const std::string& what, const std::string& expected = "") const;

  PlcClientSettings settings_;
  RegisterImage image_;
  std::unique_ptr<_modbus, Free> handle_;
};

}  // namespace brdfgate
