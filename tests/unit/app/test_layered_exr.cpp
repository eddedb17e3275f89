#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>
#include <ImfStringAttribute.h>

#include <cstdlib>
#include <opencv2/imgcodecs.hpp>

#include "app/image_export.hpp"
#include "app/layered_exr.hpp"
#include "catch.hpp"
#include "support/input_error.hpp"
#include "support/temp_dir.hpp"

using namespace brdfgate;
using brdfgate::test::contains;
using brdfgate::test::input_error;
using brdfgate::test::TempDir;

namespace {

/// A ramp whose every value is its own place.
cv::Mat ramp(int type, float offset) {
  cv::Mat image(3, 5, type);
  for (int v = 0; v < image.rows; ++v) {
    for (int i = 0; i < image.cols * image.channels(); ++i) {
      const float value = offset + 100.0F * static_cast<float>(v) + static_cast<float>(i);
      if (image.depth() == CV_8U) {
        image.ptr<unsigned char>(v)[i] = static_cast<unsigned char>(value);
      } else {
        image.ptr<float>(v)[i] = value / 7;
      }
    }
  }
  return image;
}

/// Read back through OpenCV's own EXR codec, which knows nothing of how it was written: B, G, R.
cv::Mat opencv_reads(const std::filesystem::path& file) {
  ::setenv("OPENCV_IO_ENABLE_OPENEXR", "1", 1);
  return cv::imread(file.string(), cv::IMREAD_UNCHANGED);
}

std::vector<std::string> channels_of(const std::filesystem::path& file) {
  Imf::InputFile in(file.c_str());
  std::vector<std::string> names;
  for (auto it = in.header().channels().begin(); it != in.header().channels().end(); ++it)
    names.emplace_back(it.name());
  return names;
}

/// One channel by name, as floats.
cv::Mat channel(const std::filesystem::path& file, const std::string& name) {
  Imf::InputFile in(file.c_str());
  cv::Mat out(3, 5, CV_32FC1);
  Imf::FrameBuffer buffer;
  buffer.insert(name, Imf::Slice(Imf::FLOAT, out.ptr<char>(), sizeof(float), out.step[0]));
  in.setFrameBuffer(buffer);
  in.readPixels(0, 2);
  return out;
}

double worst(const cv::Mat& a, const cv::Mat& b) {
  return cv::norm(a, b, cv::NORM_INF);
}

Inspection part_of(int channels) {
  Inspection part;
  for (const float offset : {1.0F, 2.0F}) {
    part.reflectance.push_back(
        {ramp(CV_32FC(channels), offset), ramp(CV_32FC(channels), 9 * offset), ramp(CV_8UC1, 0)});
  }
  part.result.regions.label = ramp(CV_8UC1, 3);
  return part;
}

}  // namespace

TEST_CASE("Another reader finds the reflectance that viewers show first") {
  const TempDir dir;
  const Inspection part = part_of(3);
  reflectance_image(part).write(dir / "a.exr");
  const cv::Mat seen = opencv_reads(dir / "a.exr");
  REQUIRE(seen.size() == cv::Size(5, 3));
  REQUIRE(seen.channels() == 3);
  cv::Mat rgb(seen.size(), CV_32FC3);
  cv::mixChannels(seen, rgb, {0, 2, 1, 1, 2, 0});
  CHECK(worst(rgb, part.reflectance[1].value * EIGEN_PI) < 1e-4);
}

TEST_CASE("Every layer is there under its name with its own values") {
  const TempDir dir;
  const Inspection part = part_of(3);
  reflectance_image(part).write(dir / "a.exr");
  const std::vector<std::string> expected{"B",
                                          "G",
                                          "R",
                                          "light1.B",
                                          "light1.G",
                                          "light1.R",
                                          "light1.mask",
                                          "light1.variance.B",
                                          "light1.variance.G",
                                          "light1.variance.R",
                                          "light2.B",
                                          "light2.G",
                                          "light2.R",
                                          "light2.mask",
                                          "light2.variance.B",
                                          "light2.variance.G",
                                          "light2.variance.R",
                                          "region"};
  CHECK(channels_of(dir / "a.exr") == expected);
  std::vector<cv::Mat> planes;
  cv::split(part.reflectance[0].variance, planes);
  CHECK(worst(channel(dir / "a.exr", "light1.variance.B"), planes[2]) == 0);
  cv::Mat mask, label;
  part.reflectance[0].mask.convertTo(mask, CV_32F);
  part.result.regions.label.convertTo(label, CV_32F);
  CHECK(worst(channel(dir / "a.exr", "light2.mask"), mask) == 0);
  CHECK(worst(channel(dir / "a.exr", "region"), label) == 0);
  const RadianceSet set{{ramp(CV_32FC1, 1), ramp(CV_32FC1, 2), ramp(CV_8UC1, 0)},
                        {{ramp(CV_32FC1, 3), ramp(CV_32FC1, 4), ramp(CV_8UC1, 1)}}};
  radiance_image(set).write(dir / "mono.exr");
  CHECK(channels_of(dir / "mono.exr") ==
        std::vector<std::string>{"ambient.Y", "ambient.mask", "ambient.variance.Y", "light1.Y",
                                 "light1.mask", "light1.variance.Y"});
  CHECK(worst(channel(dir / "mono.exr", "light1.Y"), set.lights[0].value) == 0);
}

TEST_CASE("An image replaces the old one whole, and what cannot be written is named") {
  const TempDir dir;
  LayeredExr exr;
  exr.add("a", ramp(CV_32FC1, 0));
  exr.attribute("brdfgate.note", "hello");
  exr.write(dir / "a.exr");
  exr.write(dir / "a.exr");
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(dir.path())) {
    CHECK(entry.path().filename() == "a.exr");
    ++files;
  }
  CHECK(files == 1);
  Imf::InputFile in((dir / "a.exr").c_str());
  CHECK(in.header().typedAttribute<Imf::StringAttribute>("brdfgate.note").value() == "hello");
  const auto nowhere = dir / "none" / "a.exr";
  CHECK(contains(input_error([&] { exr.write(nowhere); }), nowhere.string()));
  CHECK(contains(input_error([&] { exr.add("a", ramp(CV_32FC1, 0)); }), "'a.Y'"));
  CHECK(contains(input_error([&] { exr.add("b", cv::Mat(2, 2, CV_32FC1)); }), "2 x 2"));
  CHECK(contains(input_error([&] { exr.add("b", cv::Mat(3, 5, CV_64FC1)); }), "32-bit floats"));
  CHECK(contains(input_error([&] { exr.add("b", cv::Mat(3, 5, CV_32FC2)); }), "2 channels"));
  CHECK(contains(input_error([&] { LayeredExr().write(dir / "b.exr"); }), "no layer"));
}
