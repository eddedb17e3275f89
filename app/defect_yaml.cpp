#include "app/defect_yaml.hpp"

#include <bit>
#include <cstring>

#include "model/error.hpp"

namespace brdfgate {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr double kSteps = 8192;  ///< per ln unit
constexpr int kMaxSide = 4096;
constexpr int kMaxParts = 100000;

void write_image(YAML::Emitter& out, const cv::Mat& image) {
  cv::Mat packed;
  image.convertTo(packed, CV_16S, kSteps);
  out << YAML::DoubleQuoted << YAML::EncodeBase64(packed.data, packed.total() * packed.elemSize());
}

void write_images(YAML::Emitter& out, const char* key, const std::vector<cv::Mat>& images) {
  out << YAML::Key << key << YAML::Value << YAML::BeginSeq;
  for (const cv::Mat& image : images)
    write_image(out, image);
  out << YAML::EndSeq;
}

std::vector<unsigned char> bytes_of(const YamlNode& item, std::size_t expected) {
  std::vector<unsigned char> bytes = YAML::DecodeBase64(item.as_text());
  if (bytes.size() != expected) {
    item.fail(std::to_string(bytes.size()) + " bytes of base64", std::to_string(expected));
  }
  return bytes;
}

std::vector<cv::Mat> read_images(const YamlNode& node, const char* key, const cv::Size& size,
                                 int channels) {
  std::vector<cv::Mat> images;
  for (const YamlNode& item : node.at(key).items()) {
    const auto area = static_cast<std::size_t>(size.area()) * static_cast<std::size_t>(channels);
    std::vector<unsigned char> bytes = bytes_of(item, 2 * area);
    const cv::Mat packed(size, CV_16SC(channels), bytes.data());
    images.emplace_back();
    packed.convertTo(images.back(), CV_32F, 1 / kSteps);
  }
  if (images.empty() || images.size() > 2) {
    node.fail_at(key, std::to_string(images.size()) + " images", "one per light");
  }
  return images;
}

}  // namespace

void write_defect_reference(YAML::Emitter& out, const DefectReference& r) {
  const cv::Size size = r.mean.empty() ? cv::Size() : r.mean.front().size();
  out << YAML::BeginMap;
  out << YAML::Key << "parts" << YAML::Value << r.parts;
  out << YAML::Key << "limit" << YAML::Value << number_text(r.limit);
  out << YAML::Key << "tiles" << YAML::Value << YAML::Flow
      << std::vector<int>{size.width, size.height};
  out << YAML::Key << "material" << YAML::Value << YAML::BeginSeq;
  for (const Eigen::MatrixXd& m : r.material) {
    if (!m.allFinite()) throw InputError("recipe", "holds a number that is not finite");
    out << YAML::DoubleQuoted
        << YAML::EncodeBase64(reinterpret_cast<const unsigned char*>(m.data()),
                              static_cast<std::size_t>(m.size()) * sizeof(double));
  }
  out << YAML::EndSeq;
  write_images(out, "mean", r.mean);
  write_images(out, "deviation", r.deviation);
  out << YAML::EndMap;
}

DefectReference read_defect_reference(const YamlNode& node, std::size_t clusters, int components,
                                      int channels) {
  DefectReference r;
  r.parts = node.integer("parts", 1, kMaxParts);
  r.limit = node.number("limit", {0, 1e6, true});
  const auto tiles = node.numbers("tiles", 2, {1, kMaxSide});
  const cv::Size size(static_cast<int>(tiles[0]), static_cast<int>(tiles[1]));
  for (const YamlNode& item : node.at("material").items()) {
    Eigen::MatrixXd m(components, channels);
    const std::vector<unsigned char> bytes =
        bytes_of(item, static_cast<std::size_t>(m.size()) * sizeof(double));
    std::memcpy(m.data(), bytes.data(), bytes.size());
    if (!m.allFinite()) item.fail("holds a number that is not finite", "finite numbers");
    r.material.push_back(std::move(m));
  }
  if (r.material.size() != clusters) {
    node.fail_at("material", std::to_string(r.material.size()) + " materials",
                 std::to_string(clusters) + ", one per cluster");
  }
  r.mean = read_images(node, "mean", size, channels);
  r.deviation = read_images(node, "deviation", size, channels);
  if (r.mean.size() != r.deviation.size()) {
    node.fail_at("deviation", "another number of images than mean", "one per light");
  }
  for (cv::Mat& light : r.deviation) {
    double least = 0;
    cv::minMaxLoc(light.reshape(1), &least);
    if (!(least > 0)) node.fail_at("deviation", "holds a value of 0 or less", "deviations over 0");
  }
  node.finish();
  return r;
}

}  // namespace brdfgate
