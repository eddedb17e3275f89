// A chip of the kernel's GPIO simulator (gpio-sim), made through configfs.
#pragma once

#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <thread>

namespace brdfgate::test {

class GpioSim {
 public:
  /// Eight lines; `names` by number. `label` is what the chip is found by, also when it comes back
  /// under another number.
  explicit GpioSim(const std::string& label, const std::map<int, std::string>& names = {})
      : folder_(std::filesystem::path("/sys/kernel/config/gpio-sim") / label) {
    const auto bank = folder_ / "bank0";
    std::filesystem::create_directory(folder_);
    std::filesystem::create_directory(bank);
    write(bank / "num_lines", "8");
    write(bank / "label", label);
    for (const auto& [number, name] : names) {
      const auto line = bank / ("line" + std::to_string(number));
      std::filesystem::create_directory(line);
      lines_.push_back(line);
      write(line / "name", name);
    }
    plug();
  }
  ~GpioSim() {
    if (plugged_) unplug();
    for (const auto& line : lines_)
      std::filesystem::remove(line);
    std::filesystem::remove(folder_ / "bank0");
    std::filesystem::remove(folder_);
  }
  GpioSim(const GpioSim&) = delete;
  GpioSim& operator=(const GpioSim&) = delete;

  void plug() {
    write(folder_ / "live", "1");
    plugged_ = true;
    chip_ = read(folder_ / "bank0/chip_name");
    const auto device = std::filesystem::path("/sys/devices/platform") / read(folder_ / "dev_name");
    sysfs_ = device / chip_;
    // udev has the device node ready a little later.
    await([&] { return std::filesystem::exists(path()); });
  }
  void unplug() {
    write(folder_ / "live", "0");
    plugged_ = false;
  }

  std::string name() const { return chip_; }
  std::string path() const { return "/dev/" + chip_; }
  /// The level on the line, whoever drives it.
  bool level(int line) const { return read(attribute(line, "value")) == "1"; }
  /// What the outside world does to the line.
  void pull(int line, bool up) { write(attribute(line, "pull"), up ? "pull-up" : "pull-down"); }

  /// Looks until it is true; false after a minute.
  static bool await(const std::function<bool()>& what) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (!what()) {
      if (std::chrono::steady_clock::now() > deadline) return false;
      std::this_thread::yield();
    }
    return true;
  }

 private:
  std::filesystem::path attribute(int line, const char* which) const {
    return sysfs_ / ("sim_gpio" + std::to_string(line)) / which;
  }
  static void write(const std::filesystem::path& file, const std::string& text) {
    std::ofstream out(file);
    out << text << std::flush;
    if (!out) throw std::runtime_error("cannot write '" + text + "' to " + file.string());
  }
  static std::string read(const std::filesystem::path& file) {
    std::ifstream in(file);
    std::string text;
    if (!std::getline(in, text)) throw std::runtime_error("cannot read " + file.string());
    return text;
  }

  std::filesystem::path folder_;
  std::filesystem::path sysfs_;
  std::vector<std::filesystem::path> lines_;
  std::string chip_;
  bool plugged_ = false;
};

}  // namespace brdfgate::test
