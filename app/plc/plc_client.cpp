#include "app/plc/plc_client.hpp"

#include <modbus.h>

#include <cerrno>
#include <string_view>
#include <thread>
#include <utility>

#include "app/plc/plc_bits.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

constexpr int kReadTries = 5;  ///< of a result that changes while it is read

void set_response_timeout(modbus_t* handle, std::chrono::milliseconds timeout) {
  const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(timeout);
  const auto rest = std::chrono::duration_cast<std::chrono::microseconds>(timeout - seconds);
  modbus_set_response_timeout(handle, static_cast<std::uint32_t>(seconds.count()),
                              static_cast<std::uint32_t>(rest.count()));
}

}  // namespace

std::vector<std::string> reasons_in_words(ReasonBits bits) {
  constexpr std::array<const char*, 16> kWords{
      "T2",
      "SPE",
      "local defect",
      "missing cluster",
      "unknown region",
      "colour",
      "gloss",
      "tilt",
      "ambient",
      "clipped",
      "coverage",
      "outside basis",
      "hardware",
      "part absent",
      "pose or face out of range",
      "calibration or recipe missing, foreign, drifted or due"};
  std::vector<std::string> words;
  for (std::size_t i = 0; i < kWords.size(); ++i) {
    if ((bits >> i & 1) != 0) words.emplace_back(kWords[i]);
  }
  return words;
}

void PlcClient::Free::operator()(_modbus* handle) const {
  modbus_close(handle);
  modbus_free(handle);
}

PlcClient::PlcClient(PlcClientSettings settings)
    : settings_(std::move(settings)), image_(RegisterMap::built_in(), settings_.word_order) {
  const std::string service = std::to_string(settings_.port);
  handle_.reset(modbus_new_tcp_pi(settings_.host.c_str(), service.c_str()));
  if (!handle_) fail(std::string("libmodbus: ") + modbus_strerror(errno), "a host and a port");
  modbus_set_slave(handle_.get(), settings_.unit_id);
  set_response_timeout(handle_.get(), settings_.response_timeout);
  if (modbus_connect(handle_.get()) != 0) {
    fail(std::string("cannot connect: ") + modbus_strerror(errno), "a running brdfgated");
  }
}

void PlcClient::fail(const std::string& what, const std::string& expected) const {
  throw InputError("PLC gate " + settings_.host + " port " + std::to_string(settings_.port), what,
                   expected);
}

void PlcClient::read(const RegisterRange& range) {
  const std::span<std::uint16_t> words = image_.words(range);
  if (modbus_read_input_registers(handle_.get(), range.address, range.count, words.data()) !=
      range.count) {
    fail("reading registers from " + std::to_string(range.address) + ": " + modbus_strerror(errno));
  }
}

void PlcClient::write(int address, const std::vector<std::uint16_t>& words, const char* what) {
  const int count = static_cast<int>(words.size());
  if (modbus_write_registers(handle_.get(), address, count, words.data()) != count) {
    fail(std::string("writing ") + what + ": " + modbus_strerror(errno));
  }
}

const RegisterImage& PlcClient::read_station() {
  const RegisterMap& map = image_.map();
  read(map.block("station"));
  read(map.block("counters"));
  read(map.block("check"));
  const std::uint32_t magic = image_.get("station.magic");
  const std::uint32_t version = image_.get("station.map_version");
  if (magic != kMapMagic && join_u32(magic & 0xFFFF, magic >> 16, WordOrder::abcd) != kMapMagic) {
    fail("register 0 does not hold the magic number of brdfgate", "a running brdfgated");
  }
  if (magic != kMapMagic || image_.get("check.word_check") != kMapWordCheck ||
      image_.get_real("check.float_check") != 1.0F) {
    fail("the gate uses the other word order", "--word-order as configured there");
  }
  if (version >> 8 != kMapVersion >> 8) {
    fail("map version " + std::to_string(version >> 8) + "." + std::to_string(version & 0xFF),
         "version 1");
  }
  return image_;
}

std::uint32_t PlcClient::read_one(std::string_view key) {
  const RegisterField field = image_.map().field(key);
  read({field.address, field.type == RegisterType::u16 ? 1 : 2});
  return image_.get(key);
}

std::uint16_t PlcClient::status() {
  return static_cast<std::uint16_t>(read_one("station.status_bits"));
}

void PlcClient::command(std::uint16_t bits) {
  write(image_.map().field("control.command_bits").address, {bits}, "command_bits");
}

void PlcClient::write_trigger_id(std::uint32_t trigger_id) {
  const auto words = split_u32(trigger_id, settings_.word_order);
  write(image_.map().field("control.trigger_id").address, {words[0], words[1]}, "trigger_id");
}

template <class Condition>
void PlcClient::wait_until(Condition condition, const char* what) {
  const auto deadline = std::chrono::steady_clock::now() + settings_.step_timeout;
  while (!condition()) {
    if (std::chrono::steady_clock::now() >= deadline) {
      fail(std::string("no ") + what + " within " + std::to_string(settings_.step_timeout.count()) +
           " ms; state " + std::to_string(read_one("station.state")) + ", status bits " +
           std::to_string(status()));
    }
    std::this_thread::sleep_for(settings_.scan);
  }
}

std::uint16_t PlcClient::wait_for(std::uint16_t bits, bool set, const char* what) {
  std::uint16_t seen = 0;
  wait_until(
      [&] {
        seen = status();
        return (seen & bits) == (set ? bits : 0);
      },
      what);
  return seen;
}

void PlcClient::enable() {
  command(0);
  command(command_bit::kTriggerEnable);
}

void PlcClient::release() {
  command(0);
}

void PlcClient::select_recipe(std::uint16_t recipe) {
  write(image_.map().field("control.recipe").address, {recipe}, "recipe");
  command(command_bit::kTriggerEnable | command_bit::kRecipeSelect);
  command(command_bit::kTriggerEnable);
  wait_until([&] { return read_one("station.recipe_id") == recipe; }, "selected recipe in force");
}

PlcPart PlcClient::inspect(std::uint32_t trigger_id) {
  using namespace command_bit;
  wait_for(status_bit::kReady, true, "ready");
  write_trigger_id(trigger_id);
  command(kTriggerEnable | kTrigger);
  const std::uint16_t seen = status();
  if ((seen & status_bit::kMissedTrigger) != 0) fail("the trigger was missed", "ready before it");
  wait_for(status_bit::kTriggerAck, true, "trigger_ack");
  wait_for(status_bit::kAcquisitionDone, true, "acquisition_done");
  const std::uint16_t done = wait_for(status_bit::kResultValid, true, "result_valid");
  PlcPart part = read_result();
  constexpr std::uint16_t kVerdicts =
      status_bit::kPass | status_bit::kReject | status_bit::kNotJudged;
  const std::uint16_t expected = static_cast<std::uint16_t>(
      1u << (static_cast<unsigned>(part.verdict) + 4));  // bits 5, 6, 7 for verdicts 1, 2, 3
  if (part.trigger_id != trigger_id) {
    fail("result of trigger_id " + std::to_string(part.trigger_id), std::to_string(trigger_id));
  }
  if ((done & kVerdicts) != expected) {
    fail("status bits " + std::to_string(done) + " beside verdict " +
             std::to_string(static_cast<int>(part.verdict)),
         "exactly the one verdict bit that the result says");
  }
  command(kTriggerEnable | kTrigger | kResultAck);
  command(kTriggerEnable | kResultAck);
  wait_for(status_bit::kResultValid | status_bit::kTriggerAck, false, "release of the handshake");
  command(kTriggerEnable);
  return part;
}

PlcCluster PlcClient::cluster(int index) const {
  const auto real = [&](const char* key) {
    return static_cast<double>(image_.get_real(key, index));
  };
  PlcCluster c;
  c.index = index;
  c.valid_bits = static_cast<std::uint16_t>(image_.get("cluster.valid_bits", index));
  c.pixels = image_.get("cluster.pixels_16", index) * 16;
  c.area_share = real("cluster.area_share");
  c.t2 = real("cluster.t2");
  c.spe = real("cluster.spe");
  c.gloss_gu = {real("cluster.gloss_20"), real("cluster.gloss_60"), real("cluster.gloss_85")};
  c.lab = {real("cluster.lightness"), real("cluster.a_star"), real("cluster.b_star")};
  c.delta_e00 = real("cluster.delta_e00");
  c.weight_uncertainty = real("cluster.weight_uncertainty");
  for (int i = 0; i < image_.map().field("cluster.weights").count; ++i) {
    c.weights.push_back(image_.get_real("cluster.weights", index, i));
  }
  return c;
}

PlcPart PlcClient::read_result() {
  const RegisterMap& map = image_.map();
  const int clusters = map.instances("cluster");
  bool whole = false;
  for (int i = 0; i < kReadTries && !whole; ++i) {
    read(map.block("result"));
    const std::uint32_t sequence = image_.get("result.seq_head");
    whole = image_.get("result.seq_tail") == sequence;
    for (int c = 0; c < clusters; ++c) {
      read(map.block("cluster", c));
      whole = whole && image_.get("cluster.seq_head", c) == sequence &&
              image_.get("cluster.seq_tail", c) == sequence;
    }
  }
  if (!whole) fail("the result changed in each of several reads", "the same sequence throughout");
  const auto number = [&](const char* key) { return static_cast<int>(image_.get(key)); };
  const auto real = [&](const char* key) { return static_cast<double>(image_.get_real(key)); };
  PlcPart part;
  part.sequence = image_.get("result.seq_head");
  part.trigger_id = image_.get("result.trigger_id");
  part.result_id = image_.get("result.result_id");
  part.result_state = number("result.result_state");
  part.verdict = static_cast<Verdict>(number("result.verdict") & 3);
  part.reason_bits = static_cast<ReasonBits>(image_.get("result.reason_bits"));
  part.worst_cluster = number("result.worst_cluster");
  part.t2_ratio = real("result.t2_ratio");
  part.spe_ratio = real("result.spe_ratio");
  part.tilt_deg = {real("result.tilt_x_deg"), real("result.tilt_y_deg")};
  part.ambient = real("result.ambient");
  part.defects = number("result.defects");
  part.acquisition_ms = number("result.acquisition_ms");
  part.processing_ms = number("result.processing_ms");
  part.cycle_ms = number("result.cycle_ms");
  for (int c = 0; c < clusters; ++c) {
    PlcCluster read = cluster(c);
    if ((read.valid_bits & valid_bit::kPresent) != 0) part.clusters.push_back(std::move(read));
  }
  return part;
}

}  // namespace brdfgate
