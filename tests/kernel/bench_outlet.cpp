#include "kernel/bench_outlet.hpp"

#include <fcntl.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <stdexcept>
#include <utility>

namespace brdfgate::lab {

LoopbackOutlet::LoopbackOutlet(const std::string& node, const SensorFormat& sensor,
                               double exposure_s)
    : fd_(::open(node.c_str(), O_RDWR)), exposure_s_(exposure_s) {
  if (!fd_) throw std::runtime_error("cannot open " + node);
  v4l2_format format{};
  format.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
  format.fmt.pix.width = static_cast<std::uint32_t>(sensor.width);
  format.fmt.pix.height = static_cast<std::uint32_t>(sensor.height);
  format.fmt.pix.pixelformat = V4L2_PIX_FMT_Y16;
  format.fmt.pix.field = V4L2_FIELD_NONE;
  format.fmt.pix.bytesperline = format.fmt.pix.width * 2;
  format.fmt.pix.sizeimage = format.fmt.pix.bytesperline * format.fmt.pix.height;
  if (::ioctl(fd_.get(), VIDIOC_S_FMT, &format) != 0) {
    throw std::runtime_error("VIDIOC_S_FMT refused");
  }
}

void LoopbackOutlet::put(const cv::Mat& frame) {
  const std::size_t bytes = frame.total() * frame.elemSize();
  if (::write(fd_.get(), frame.data, bytes) != static_cast<ssize_t>(bytes)) {
    throw std::runtime_error("the loopback takes no frame");
  }
}

UsbOutlet::UsbOutlet(const SensorFormat& sensor) : width_(sensor.width), height_(sensor.height) {
  plug(true);
}

void UsbOutlet::plug(bool in) {
  if (!in) camera_.reset();
  if (in && !camera_) camera_ = std::make_unique<UvcCamera>(width_, height_);
}

std::optional<ExposureRequest> UsbOutlet::next_exposure() {
  if (!camera_ || !camera_->streaming()) return std::nullopt;
  const UvcSettings now = deaf_ ? latched_ : std::exchange(latched_, camera_->settings());
  return ExposureRequest{.exposure_s = now.exposure_100us * 100e-6, .gain = now.gain / 16.0};
}

void UsbOutlet::put(const cv::Mat& frame) {
  // A host that stops in mid-frame is no failure: the next one begins anew.
  if (camera_) static_cast<void>(camera_->send(frame));
}

}  // namespace brdfgate::lab
