#include "app/plc/counters.hpp"

#include <fcntl.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utility>

#include "hal/modbus/unique_fd.hpp"
#include "model/error.hpp"
#include "model/hash.hpp"

namespace brdfgate {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kSchema = "brdfgate.counters/1";

constexpr std::array<std::pair<const char*, std::uint32_t Counters::*>, 9> kFields{{
    {"inspected", &Counters::inspected},
    {"passed", &Counters::passed},
    {"rejected", &Counters::rejected},
    {"not_judged", &Counters::not_judged},
    {"missed_triggers", &Counters::missed_triggers},
    {"faults", &Counters::faults},
    {"restarts", &Counters::restarts},
    {"clients_refused", &Counters::clients_refused},
    {"last_result_id", &Counters::last_result_id},
}};

std::string encode(const Counters& counters) {
  Json numbers;
  for (const auto& [name, field] : kFields)
    numbers[name] = counters.*field;
  Json document;
  document["schema"] = kSchema;
  document["counters"] = numbers;
  document["sha256"] = sha256_hex(numbers.dump());
  return document.dump(2) + "\n";
}

/// Throws whatever is wrong with the text.
Counters decode(const std::string& text) {
  const Json document = Json::parse(text);
  const Json& numbers = document.at("counters");
  if (document.at("schema") != kSchema) throw std::runtime_error("another schema");
  if (document.at("sha256") != sha256_hex(numbers.dump())) throw std::runtime_error("checksum");
  Counters counters;
  for (const auto& [name, field] : kFields)
    counters.*field = numbers.at(name).get<std::uint32_t>();
  return counters;
}

[[noreturn]] void fail(const std::filesystem::path& file, const std::string& call) {
  throw InputError(file.string(), call + ": " + std::strerror(errno),
                   "a directory that can be written");
}

void sync(const std::filesystem::path& path, int flags) {
  const UniqueFd fd(::open(path.c_str(), flags | O_CLOEXEC));
  if (!fd) fail(path, "open");
  if (::fsync(fd.get()) != 0) fail(path, "fsync");
}

void write_atomically(const std::filesystem::path& file, const std::string& text) {
  const std::filesystem::path beside = file.string() + ".new";
  {
    std::ofstream out(beside, std::ios::binary | std::ios::trunc);
    out << text;
    out.flush();
    if (!out) fail(beside, "write");
  }
  sync(beside, O_RDONLY);
  if (std::rename(beside.c_str(), file.c_str()) != 0) fail(file, "rename");
  sync(file.parent_path(), O_RDONLY | O_DIRECTORY);
}

}  // namespace

CounterFile::CounterFile(const std::filesystem::path& state_dir)
    : file_(state_dir / "counters.json") {
  std::error_code error;
  std::filesystem::create_directories(state_dir, error);
  if (error) {
    throw InputError(state_dir.string(), "create: " + error.message(),
                     "a directory that can be written");
  }
  Counters counters;
  if (std::ifstream in(file_, std::ios::binary); in) {
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    try {
      counters = decode(text);
    } catch (const std::exception& problem) {
      warning_ = file_.string() + ": damaged (" + problem.what() + "); counters begin at zero";
      std::filesystem::rename(file_, file_.string() + ".damaged", error);
    }
  }
  ++counters.restarts;
  counters.last_result_id += kResultIdGap;
  write_atomically(file_, encode(counters));
  stored_ = counters;
}

void CounterFile::store(const Counters& counters) {
  if (counters == stored_) return;
  write_atomically(file_, encode(counters));
  stored_ = counters;
}

}  // namespace brdfgate
