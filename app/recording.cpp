#include "app/recording.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <opencv2/core.hpp>

#include "config/png_file.hpp"
#include "config/sensor_yaml.hpp"
#include "config/yaml_reader.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;

constexpr const char* kIndexName = "recording.yaml";
constexpr const char* kSchema = "brdfgate.recording/1";
constexpr std::size_t kMaxFrames = 10000;

const std::vector<std::string>& role_names() {
  static const std::vector<std::string> names{"part",  "white",  "dark",  "ptc",
                                              "board", "mirror", "black", "chart"};
  return names;
}

/// The folder itself, without a trailing slash or dots that would hide its name.
fs::path named(const fs::path& dir) {
  fs::path out = fs::absolute(dir).lexically_normal();
  return out.has_filename() ? out : out.parent_path();
}

/// On disk the lights count from 0 and an ambient frame has `none` (cli.md, "Recording").
const std::vector<std::string>& light_names() {
  static const std::vector<std::string> names{"none", "0", "1"};
  return names;
}

/// A recording's frames lie in its folder; a path that leaves it is somebody's trick or mistake.
fs::path frame_path(const YamlNode& node, const fs::path& dir) {
  const std::string text = node.as_text();
  const fs::path file = fs::path(text).lexically_normal();
  const bool inside = !text.empty() && !file.is_absolute() && *file.begin() != "..";
  if (!inside) node.fail(shown(text), "a file inside the recording's folder");
  return dir / file;
}

void check_counts(const cv::Mat& counts, const SensorFormat& sensor, const fs::path& file) {
  double most = 0;
  cv::Point at;
  cv::minMaxLoc(counts, nullptr, &most, nullptr, &at);
  const int top = (1 << sensor.bits) - 1;
  if (most <= top) return;
  throw InputError(
      file.string(),
      "count " + number_text(most) + " in column " + std::to_string(at.x) + ", row " +
          std::to_string(at.y),
      "at most " + std::to_string(top) + " from " + std::to_string(sensor.bits) + " bits");
}

RawFrame read_frame(const YamlNode& node, const fs::path& dir, const SensorFormat& sensor) {
  RawFrame frame;
  frame.light = static_cast<LightIndex>(node.choice("light", light_names()));
  frame.exposure_s = node.number("exposure_s", {0, 3600, true});
  frame.gain = node.number("gain", {0, 1000, true});
  frame.timestamp_ns = node.integer64("timestamp_ns", INT64_MIN, INT64_MAX);
  const YamlNode name = node.at("file");
  node.finish();
  const fs::path file = frame_path(name, dir);
  try {
    frame.counts = read_gray_png(file, {16, {sensor.width, sensor.height}});
    check_counts(frame.counts, sensor, file);
  } catch (const InputError& error) {
    throw InputError(name.where(), error.what());
  }
  return frame;
}

void check_writable(const Recording& recording, const std::string& where) {
  const SensorFormat& sensor = recording.capture.sensor;
  if (recording.capture.frames.empty()) throw InputError(where, "no frames", "at least one");
  for (const RawFrame& frame : recording.capture.frames) {
    const bool fits = frame.counts.type() == CV_16UC1 &&
                      frame.counts.size() == cv::Size(sensor.width, sensor.height);
    if (!fits) throw InputError(where, "a frame of another format", "the sensor's, CV_16UC1");
    if (frame.light < 0 || frame.light >= static_cast<int>(light_names().size())) {
      throw InputError(where, "a frame under light " + std::to_string(frame.light), "0, 1 or 2");
    }
  }
}

/// 000_none.png, 001_light0.png, ...: in the order taken.
std::string frame_name(std::size_t index, LightIndex light) {
  std::array<char, 32> number{};
  std::snprintf(number.data(), number.size(), "%03zu_", index);
  const std::string& name = light_names().at(static_cast<std::size_t>(light));
  return number.data() + (light == kNoLight ? name : "light" + name) + ".png";
}

void emit_sensor(YAML::Emitter& out, const SensorFormat& sensor) {
  out << YAML::Key << "sensor" << YAML::Value << YAML::Flow << YAML::BeginMap;
  out << YAML::Key << "width" << YAML::Value << sensor.width;
  out << YAML::Key << "height" << YAML::Value << sensor.height;
  out << YAML::Key << "bits" << YAML::Value << sensor.bits;
  out << YAML::Key << "mosaic" << YAML::Value << mosaic_name(sensor.mosaic);
  out << YAML::Key << "black_level" << YAML::Value << number_text(sensor.black_level_dn);
  out << YAML::Key << "full_well_dn" << YAML::Value << number_text(sensor.full_well_dn);
  out << YAML::EndMap;
}

void emit_frame(YAML::Emitter& out, const RawFrame& frame, const std::string& file) {
  out << YAML::Flow << YAML::BeginMap;
  out << YAML::Key << "file" << YAML::Value << file;
  out << YAML::Key << "light" << YAML::Value
      << light_names().at(static_cast<std::size_t>(frame.light));
  out << YAML::Key << "exposure_s" << YAML::Value << number_text(frame.exposure_s);
  out << YAML::Key << "gain" << YAML::Value << number_text(frame.gain);
  out << YAML::Key << "timestamp_ns" << YAML::Value << frame.timestamp_ns;
  out << YAML::EndMap;
}

std::string index_text(const Recording& recording) {
  YAML::Emitter out;
  out << YAML::BeginMap;
  out << YAML::Key << "schema" << YAML::Value << kSchema;
  out << YAML::Key << "role" << YAML::Value
      << role_names().at(static_cast<std::size_t>(recording.role));
  out << YAML::Key << "station" << YAML::Value << YAML::DoubleQuoted << recording.station_hash;
  out << YAML::Key << "calibration" << YAML::Value << YAML::DoubleQuoted
      << recording.calibration_hash;
  emit_sensor(out, recording.capture.sensor);
  out << YAML::Key << "frames" << YAML::Value << YAML::BeginSeq;
  for (std::size_t i = 0; i < recording.capture.frames.size(); ++i) {
    const RawFrame& frame = recording.capture.frames[i];
    emit_frame(out, frame, frame_name(i, frame.light));
  }
  out << YAML::EndSeq << YAML::EndMap;
  return std::string(out.c_str()) + "\n";
}

/// A folder that goes away again unless it was kept: a broken write leaves nothing behind.
class PendingFolder {
 public:
  explicit PendingFolder(const fs::path& final_path)
      : final_(final_path), path_(final_path.string() + ".tmp-" + std::to_string(getpid())) {
    fs::create_directories(final_.parent_path());
    fs::remove_all(path_);
    fs::create_directory(path_);
  }
  PendingFolder(const PendingFolder&) = delete;
  PendingFolder& operator=(const PendingFolder&) = delete;
  ~PendingFolder() {
    std::error_code ignored;
    if (!kept_) fs::remove_all(path_, ignored);
  }
  const fs::path& path() const { return path_; }
  void keep() {
    fs::rename(path_, final_);
    kept_ = true;
  }

 private:
  fs::path final_;
  fs::path path_;
  bool kept_ = false;
};

void write_text(const fs::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text;
  out.close();
  if (!out) throw InputError(file.string(), "cannot be written", "a writable folder with space");
}

}  // namespace

Recording read_recording(const fs::path& dir) {
  const fs::path folder = named(dir);
  const YamlNode root = YamlNode::load_file(dir / kIndexName);
  Recording recording;
  recording.name = folder.filename().string();
  root.choice("schema", {kSchema});
  recording.role = static_cast<RecordingRole>(root.choice("role", role_names()));
  recording.station_hash = root.text("station");
  recording.calibration_hash = root.text_or("calibration", "");
  const YamlNode sensor = root.at("sensor");
  recording.capture.sensor = read_sensor_format(sensor, "black_level");
  sensor.finish();
  const YamlNode frames = root.at("frames");
  root.finish();
  const std::vector<YamlNode> nodes = frames.items();
  if (nodes.empty() || nodes.size() > kMaxFrames) {
    frames.fail(std::to_string(nodes.size()) + " frames", "1 to " + std::to_string(kMaxFrames));
  }
  for (const YamlNode& node : nodes) {
    recording.capture.frames.push_back(read_frame(node, dir, recording.capture.sensor));
  }
  return recording;
}

void write_recording(const fs::path& dir, const Recording& recording) {
  const fs::path folder = named(dir);
  check_writable(recording, folder.string());
  try {
    if (fs::exists(fs::symlink_status(folder))) {
      throw InputError(folder.string(), "exists already", "a new folder");
    }
    PendingFolder pending(folder);
    for (std::size_t i = 0; i < recording.capture.frames.size(); ++i) {
      const RawFrame& frame = recording.capture.frames[i];
      write_gray_png(pending.path() / frame_name(i, frame.light), frame.counts);
    }
    write_text(pending.path() / kIndexName, index_text(recording));
    pending.keep();
  } catch (const fs::filesystem_error& error) {
    throw InputError(folder.string(), "cannot be written: " + error.code().message(),
                     "a new folder in a writable one");
  }
}

std::vector<fs::path> find_recordings(const fs::path& dir) {
  std::error_code error;
  if (fs::exists(dir / kIndexName, error)) return {dir};
  std::vector<fs::path> out;
  for (fs::directory_iterator entry(dir, error), end; !error && entry != end;
       entry.increment(error)) {
    const fs::path& path = entry->path();
    // What a broken write left behind is no recording.
    if (path.filename().string().find(".tmp-") != std::string::npos) continue;
    std::error_code ignored;
    if (fs::exists(path / kIndexName, ignored)) out.push_back(path);
  }
  if (error) throw InputError(dir.string(), "cannot be read: " + error.message(), "a folder");
  if (out.empty()) {
    throw InputError(dir.string(), "no recording",
                     std::string(kIndexName) + " in it or in its subfolders");
  }
  std::sort(out.begin(), out.end());
  return out;
}

}  // namespace brdfgate
