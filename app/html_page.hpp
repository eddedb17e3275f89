// What reports share: self-contained HTML pages, with their pictures in them, without scripts or
// links, so that they open anywhere and can be filed.
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "app/plot.hpp"

namespace brdfgate {

/// Text that a page shows as it is: < > & and quotes escaped.
std::string html_text(const std::string& text);

/// RFC 4648, with padding.
std::string base64(const std::string& bytes);

/// Encoded as PNG. The plot is drawn by gnuplot; throws InputError where it is not installed.
std::string png_of(const cv::Mat& image);
std::string png_of(const Plot& plot);

/// A figure with its caption, which is its description too.
std::string image_tag(const std::string& png, const std::string& caption);

/// One row of a table of facts: name, value.
std::string fact_row(const std::string& name, const std::string& value);

/// Values around 0, +-span, as blue over white to red; black where not finite.
cv::Mat diverging(const cv::Mat1f& values, double span);

/// A whole document. `style` and `body` are markup, `title` is text.
std::string html_page(const std::string& title, const std::string& style, const std::string& body);

}  // namespace brdfgate
