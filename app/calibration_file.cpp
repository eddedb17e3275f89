#include "app/calibration_file.hpp"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>
#include <ImfTestFile.h>
#include <half.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <optional>
#include <system_error>

#include "app/calibration_head.hpp"
#include "model/error.hpp"
#include "model/hash.hpp"

namespace brdfgate {
namespace {

constexpr const char* kHeadAttribute = "brdfgate.calibration";
constexpr int kLargestSide = 16384;  // cells; nothing larger is allocated for a file's sake
/// Fraction bits kept of a sigma: an error of 3 % at most, which no weight notices; the rest of the
/// half's eleven would only be stored noise.
constexpr unsigned int kSigmaBits = 4;
constexpr float kLargestHalf = 65504.0F;

/// One named plane of half floats.
using Plane = std::vector<half>;
/// Name -> plane, in the order of OpenEXR's channel lists (by name).
using Planes = std::map<std::string, Plane>;

std::string layer_prefix(std::size_t light) {
  return "light" + std::to_string(light + 1) + ".";
}

std::vector<std::string> channel_names(int channels) {
  if (channels == 1) return {"Y"};
  return {"R", "G", "B"};
}

half to_half(float value) {
  return half(std::clamp(value, -kLargestHalf, kLargestHalf));
}

/// The largest unmasked value: it becomes 1, so that halves carry their full eleven bits.
double scale_of(const Radiance& white) {
  double largest = 0;
  const int channels = white.value.channels();
  for (int v = 0; v < white.value.rows; ++v) {
    const auto* x = white.value.ptr<float>(v);
    const auto* bad = white.mask.ptr<unsigned char>(v);
    for (int i = 0; i < white.value.cols * channels; ++i) {
      if (bad[i / channels] == 0) largest = std::max(largest, static_cast<double>(x[i]));
    }
  }
  return largest > 0 ? largest : 1;
}

void add_planes(const Radiance& white, std::size_t light, double scale, Planes& planes) {
  const std::string prefix = layer_prefix(light);
  const int channels = white.value.channels();
  const std::vector<std::string> names = channel_names(channels);
  const std::size_t cells = white.value.total();
  const auto* value = white.value.ptr<float>();
  const auto* variance = white.variance.ptr<float>();
  const auto per_scale = static_cast<float>(1 / scale);
  for (int c = 0; c < channels; ++c) {
    Plane& x = planes[prefix + "white." + names[static_cast<std::size_t>(c)]];
    Plane& sigma = planes[prefix + "sigma." + names[static_cast<std::size_t>(c)]];
    x.resize(cells);
    sigma.resize(cells);
    for (std::size_t i = 0; i < cells; ++i) {
      const std::size_t at = i * static_cast<std::size_t>(channels) + static_cast<std::size_t>(c);
      x[i] = to_half(value[at] * per_scale);
      sigma[i] = to_half(std::sqrt(variance[at]) * per_scale).round(kSigmaBits);
    }
  }
  const auto* mask = white.mask.ptr<unsigned char>();
  Plane& bits = planes[prefix + "mask"];
  std::transform(mask, mask + cells, std::back_inserter(bits),
                 [](unsigned char m) { return half(static_cast<float>(m)); });
}

Radiance from_planes(const Planes& planes, std::size_t light, double scale, cv::Size size,
                     int channels) {
  const std::string prefix = layer_prefix(light);
  const std::vector<std::string> names = channel_names(channels);
  Radiance white;
  white.value.create(size, CV_32FC(channels));
  white.variance.create(size, CV_32FC(channels));
  white.mask.create(size, CV_8UC1);
  const auto to_dn = static_cast<float>(scale);
  const std::size_t cells = white.value.total();
  for (int c = 0; c < channels; ++c) {
    const Plane& x = planes.at(prefix + "white." + names[static_cast<std::size_t>(c)]);
    const Plane& sigma = planes.at(prefix + "sigma." + names[static_cast<std::size_t>(c)]);
    for (std::size_t i = 0; i < cells; ++i) {
      const std::size_t at = i * static_cast<std::size_t>(channels) + static_cast<std::size_t>(c);
      const float s = static_cast<float>(sigma[i]) * to_dn;
      white.value.ptr<float>()[at] = static_cast<float>(x[i]) * to_dn;
      white.variance.ptr<float>()[at] = s * s;
    }
  }
  const Plane& mask = planes.at(prefix + "mask");
  std::transform(mask.begin(), mask.end(), white.mask.ptr<unsigned char>(), [](half m) {
    return static_cast<unsigned char>(std::clamp(static_cast<float>(m), 0.0F, 255.0F));
  });
  return white;
}

/// SHA-256 over the head's text, then name and halves (little-endian) of each plane in the order of
/// the names: independent of how the file was compressed.
std::string content_hash(const std::string& head_text, const Planes& planes) {
  std::string bytes = head_text;
  for (const auto& [name, plane] : planes) {
    bytes += '\n' + name + '\n';
    bytes.append(reinterpret_cast<const char*>(plane.data()), plane.size() * sizeof(half));
  }
  return sha256_hex(bytes);
}

Imf::FrameBuffer frame_buffer(Planes& planes, int width) {
  Imf::FrameBuffer buffer;
  for (auto& [name, plane] : planes) {
    buffer.insert(name, Imf::Slice(Imf::HALF, reinterpret_cast<char*>(plane.data()), sizeof(half),
                                   sizeof(half) * static_cast<std::size_t>(width)));
  }
  return buffer;
}

void write_exr(const std::filesystem::path& file, const std::string& head, cv::Size size,
               Planes& planes) {
  Imf::Header header(size.width, size.height);
  header.compression() =
      Imf::PIZ_COMPRESSION;  // wavelets: the smallest lossless one on noisy planes
  header.insert(kHeadAttribute, Imf::StringAttribute(head));
  for (const auto& entry : planes)
    header.channels().insert(entry.first, Imf::Channel(Imf::HALF));
  Imf::OutputFile out(file.c_str(), header);
  out.setFrameBuffer(frame_buffer(planes, size.width));
  out.writePixels(size.height);
}

/// Under a name of its own beside the file, then renamed: nobody ever sees half a calibration.
void write_atomically(const std::filesystem::path& file, const std::string& head, cv::Size size,
                      Planes& planes) {
  std::filesystem::path beside = file;
  beside += ".new." + std::to_string(::getpid());
  std::error_code ignored;
  try {
    write_exr(beside, head, size, planes);
    std::filesystem::rename(beside, file);
  } catch (const std::exception& e) {
    std::filesystem::remove(beside, ignored);
    throw InputError(file.string(), std::string("cannot be written: ") + e.what(),
                     "a folder that exists, is writable and has room");
  }
}

void check_white(const Calibration& calibration) {
  const std::size_t lights = calibration.geometry.lights_W.size();
  if (calibration.white.size() != lights || lights == 0) {
    throw InputError("calibration", std::to_string(calibration.white.size()) + " white references",
                     "one for each of the " + std::to_string(lights) + " lights, at least one");
  }
  const cv::Size size = calibration.sensor.cells();
  const int type = CV_32FC(calibration.sensor.channels());
  for (const Radiance& white : calibration.white) {
    const bool fits = white.value.size() == size && white.variance.size() == size &&
                      white.mask.size() == size && white.value.type() == type &&
                      white.variance.type() == type && white.mask.type() == CV_8UC1;
    const bool whole =
        white.value.isContinuous() && white.variance.isContinuous() && white.mask.isContinuous();
    if (!fits || !whole) {
      throw InputError("calibration", "a white reference of another layout than the sensor's",
                       std::to_string(size.width) + " x " + std::to_string(size.height) + " cells");
    }
  }
}

std::string head_of(const Imf::InputFile& in, const std::string& name) {
  const auto* head = in.header().findTypedAttribute<Imf::StringAttribute>(kHeadAttribute);
  if (head == nullptr) {
    throw InputError(
        name, std::string("an OpenEXR image without the header attribute '") + kHeadAttribute + "'",
        "a calibration written by `brdfgate calibrate`");
  }
  return head->value();
}

void check_size(const Imf::InputFile& in, const SensorFormat& sensor, const std::string& name) {
  const auto& window = in.header().dataWindow();
  const cv::Size cells = sensor.cells();
  if (window.min.x != 0 || window.min.y != 0 || window.max.x != cells.width - 1 ||
      window.max.y != cells.height - 1) {
    throw InputError(name,
                     "pixels " + std::to_string(window.min.x) + ".." +
                         std::to_string(window.max.x) + " x " + std::to_string(window.min.y) +
                         ".." + std::to_string(window.max.y),
                     std::to_string(cells.width) + " x " + std::to_string(cells.height) +
                         " cells of the sensor in its head");
  }
}

/// Empty planes of every layer that a calibration must have.
Planes expected_planes(std::size_t lights, const SensorFormat& sensor) {
  Planes planes;
  const auto cells = static_cast<std::size_t>(sensor.cells().area());
  for (std::size_t l = 0; l < lights; ++l) {
    planes[layer_prefix(l) + "mask"].resize(cells);
    for (const std::string& channel : channel_names(sensor.channels())) {
      planes[layer_prefix(l) + "white." + channel].resize(cells);
      planes[layer_prefix(l) + "sigma." + channel].resize(cells);
    }
  }
  return planes;
}

void check_layers(const Imf::InputFile& in, const Planes& planes, const std::string& name) {
  for (const auto& entry : planes) {
    const Imf::Channel* channel = in.header().channels().findChannel(entry.first);
    if (channel == nullptr) {
      throw InputError(name, "layer '" + entry.first + "' is missing",
                       "white, sigma and mask of every light");
    }
    if (channel->type != Imf::HALF || channel->xSampling != 1 || channel->ySampling != 1) {
      throw InputError(name, "layer '" + entry.first + "' is not one half float per cell",
                       "half floats, not subsampled");
    }
  }
}

Calibration read_open(Imf::InputFile& in, const std::string& name) {
  const std::string head_text = head_of(in, name);
  CalibrationHead head = parse_calibration_head(head_text, name + " (head)");
  Calibration& calibration = head.calibration;
  check_size(in, calibration.sensor, name);
  Planes planes = expected_planes(head.white_scale.size(), calibration.sensor);
  check_layers(in, planes, name);
  const cv::Size size = calibration.sensor.cells();
  in.setFrameBuffer(frame_buffer(planes, size.width));
  in.readPixels(0, size.height - 1);
  calibration.hash = content_hash(without_checksum(head_text), planes);
  if (calibration.hash != head.checksum) {
    throw InputError(name, "checksum " + calibration.hash + " of the content",
                     head.checksum + " as its head says: the file was damaged or edited");
  }
  for (std::size_t l = 0; l < head.white_scale.size(); ++l) {
    calibration.white.push_back(
        from_planes(planes, l, head.white_scale[l], size, calibration.sensor.channels()));
  }
  return std::move(head.calibration);
}

}  // namespace

std::string write_calibration(const std::filesystem::path& file, const Calibration& calibration) {
  check_white(calibration);
  Planes planes;
  std::vector<double> scale;
  for (std::size_t l = 0; l < calibration.white.size(); ++l) {
    scale.push_back(scale_of(calibration.white[l]));
    add_planes(calibration.white[l], l, scale.back(), planes);
  }
  const std::string head = calibration_head_text(calibration, scale);
  const std::string hash = content_hash(head, planes);
  write_atomically(file, with_checksum(head, hash), calibration.sensor.cells(), planes);
  return hash;
}

Calibration read_calibration(const std::filesystem::path& file) {
  const std::string name = file.string();
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) {
    throw InputError(name, "no such file", "a calibration written by `brdfgate calibrate`");
  }
  if (!Imf::isOpenExrFile(file.c_str())) {
    throw InputError(name, "not an OpenEXR image", "a calibration written by `brdfgate calibrate`");
  }
  try {
    Imf::Header::setMaxImageSize(kLargestSide, kLargestSide);
    Imf::InputFile in(file.c_str());
    return read_open(in, name);
  } catch (const InputError&) {
    throw;
  } catch (const std::exception& e) {
    throw InputError(name, std::string("a damaged OpenEXR image: ") + e.what(),
                     "the file as it was written");
  }
}

}  // namespace brdfgate
