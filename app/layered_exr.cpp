#include "app/layered_exr.hpp"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>
#include <unistd.h>

#include <algorithm>
#include <system_error>

#include "model/error.hpp"

namespace brdfgate {
namespace {

std::string size_text(const cv::Mat& image) {
  return std::to_string(image.cols) + " x " + std::to_string(image.rows);
}

}  // namespace

void LayeredExr::add(const std::string& layer, const cv::Mat& image) {
  const std::string prefix = layer.empty() ? "" : layer + ".";
  if (image.channels() == 1) return add_channel(prefix + "Y", image);
  if (image.channels() != 3) {
    throw InputError("layer '" + layer + "'", std::to_string(image.channels()) + " channels",
                     "one or three");
  }
  std::vector<cv::Mat> planes;
  cv::split(image, planes);
  add_channel(prefix + "R", planes[0]);
  add_channel(prefix + "G", planes[1]);
  add_channel(prefix + "B", planes[2]);
}

void LayeredExr::add_channel(const std::string& name, const cv::Mat& image) {
  if (image.type() != CV_32FC1 && image.type() != CV_8UC1) {
    throw InputError("channel '" + name + "'", "of type " + cv::typeToString(image.type()),
                     "32-bit floats or bytes");
  }
  if (!channels_.empty() && image.size() != channels_.front().second.size()) {
    throw InputError("channel '" + name + "'", size_text(image),
                     size_text(channels_.front().second) + " as the others");
  }
  if (std::any_of(channels_.begin(), channels_.end(),
                  [&](const auto& other) { return other.first == name; })) {
    throw InputError("channel '" + name + "'", "there is one already", "every name once");
  }
  cv::Mat floats;
  image.convertTo(floats, CV_32F);  // a copy of its own, continuous
  channels_.emplace_back(name, floats);
}

void LayeredExr::attribute(const std::string& name, const std::string& text) {
  attributes_.emplace_back(name, text);
}

void LayeredExr::write(const std::filesystem::path& file) const {
  if (channels_.empty()) throw InputError(file.string(), "no layer to write");
  const cv::Size size = channels_.front().second.size();
  Imf::Header header(size.width, size.height);
  header.compression() = Imf::ZIP_COMPRESSION;
  for (const auto& [name, text] : attributes_)
    header.insert(name, Imf::StringAttribute(text));
  Imf::FrameBuffer buffer;
  for (const auto& [name, plane] : channels_) {
    header.channels().insert(name, Imf::Channel(Imf::FLOAT));
    // The library reads through a pointer to non-const.
    char* base = const_cast<char*>(plane.ptr<char>());  // NOLINT(*-const-cast)
    buffer.insert(name, Imf::Slice(Imf::FLOAT, base, sizeof(float), plane.step[0]));
  }
  std::filesystem::path beside = file;
  beside += ".new." + std::to_string(::getpid());
  std::error_code ignored;
  try {
    {
      Imf::OutputFile out(beside.c_str(), header);
      out.setFrameBuffer(buffer);
      out.writePixels(size.height);
    }
    std::filesystem::rename(beside, file);
  } catch (const std::exception& e) {
    std::filesystem::remove(beside, ignored);
    throw InputError(file.string(), std::string("cannot be written: ") + e.what(),
                     "a folder that exists, is writable and has room");
  }
}

}  // namespace brdfgate
