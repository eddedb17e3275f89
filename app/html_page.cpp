#include "app/html_page.hpp"

#include <fmt/core.h>
#include <openssl/evp.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "app/temp_folder.hpp"
#include "model/mapped_file.hpp"

namespace brdfgate {

std::string html_text(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

std::string base64(const std::string& bytes) {
  std::string out(4 * ((bytes.size() + 2) / 3) + 1, '\0');  // the encoder ends with a zero
  const int n = EVP_EncodeBlock(reinterpret_cast<unsigned char*>(out.data()),
                                reinterpret_cast<const unsigned char*>(bytes.data()),
                                static_cast<int>(bytes.size()));
  out.resize(static_cast<std::size_t>(n));
  return out;
}

std::string image_tag(const std::string& png, const std::string& caption) {
  return fmt::format(
      "<figure><img alt=\"{0}\" src=\"data:image/png;base64,{1}\"><figcaption>{0}</figcaption>"
      "</figure>\n",
      html_text(caption), base64(png));
}

std::string png_of(const cv::Mat& image) {
  std::vector<unsigned char> bytes;
  cv::imencode(".png", image, bytes);
  return {bytes.begin(), bytes.end()};
}

std::string png_of(const Plot& plot) {
  const TempFolder folder;
  const auto file = folder / "plot.png";
  write_plot(plot, file);
  const MappedFile png(file);
  return {reinterpret_cast<const char*>(png.bytes().data()), png.bytes().size()};
}

/// Values around 0, +-span, as blue over white to red; black where not finite.
cv::Mat diverging(const cv::Mat1f& values, double span) {
  cv::Mat3b out(values.size());
  for (int y = 0; y < values.rows; ++y) {
    for (int x = 0; x < values.cols; ++x) {
      const double v = values(y, x) / span;
      const double pale = 255 * (1 - std::min(1.0, std::abs(v)));
      const auto low = cv::saturate_cast<unsigned char>(pale);
      out(y, x) = !std::isfinite(v) ? cv::Vec3b(0, 0, 0)
                  : v < 0           ? cv::Vec3b(255, low, low)
                                    : cv::Vec3b(low, low, 255);
    }
  }
  return out;
}

std::string fact_row(const std::string& name, const std::string& value) {
  return fmt::format("<tr><th>{}</th><td>{}</td></tr>\n", html_text(name), html_text(value));
}

std::string html_page(const std::string& title, const std::string& style, const std::string& body) {
  return fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
      "<meta name=\"viewport\" content=\"width=device-width\"><title>{}</title>"
      "<style>{}</style></head><body>\n{}</body></html>\n",
      html_text(title), style, body);
}

}  // namespace brdfgate
