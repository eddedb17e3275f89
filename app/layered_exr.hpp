// OpenEXR images of many named layers, which viewers list as groups: light1.R, light1.variance.R.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

namespace brdfgate {

/// An image with named channels, as 32-bit floats (masks and labels too: every viewer shows
/// floats).
class LayeredExr {
 public:
  /// `image`, CV_32F or CV_8U of one or three channels (R, G, B order), as <layer>.R, .G and .B, or
  /// <layer>.Y; an empty layer gives plain R, G, B or Y, what viewers show first.
  /// Throws InputError: another type, another size than the images before, a name given twice.
  void add(const std::string& layer, const cv::Mat& image);
  /// One channel under exactly this name.
  void add_channel(const std::string& name, const cv::Mat& image);
  /// A header attribute of text, for people.
  void attribute(const std::string& name, const std::string& text);

  /// Zip-compressed, written beside and renamed: nobody sees half an image. Throws InputError with
  /// the file's name: no layer, a place that cannot be written.
  void write(const std::filesystem::path& file) const;

 private:
  std::vector<std::pair<std::string, cv::Mat>> channels_;  ///< CV_32FC1, continuous
  std::vector<std::pair<std::string, std::string>> attributes_;
};

}  // namespace brdfgate
