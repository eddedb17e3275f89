// Pictures for people: what the lights showed, what was found, what the materials look like.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "app/inspector.hpp"

namespace brdfgate {

/// 8-bit BGR images, ready for a PNG.
struct PartPictures {
  cv::Mat light1;    ///< reflectance under light 1, tone-mapped
  cv::Mat light2;    ///< the same under light 2
  cv::Mat regions;   ///< one colour per cluster; unknown red; not part black
  cv::Mat residual;  ///< ln(f / the cluster's own angular mean) under both lights: blue darker, red
                     ///< lighter
  cv::Mat spheres;   ///< one row: each cluster's reconstructed BRDF on a sphere
};

/// Logarithmic tone curve over three decades below the brightest percent, sRGB-encoded.
cv::Mat tone_map(const Reflectance& reflectance);

/// Where there is nothing to see, on pages.
inline constexpr unsigned char kNothingGrey = 205;

/// One colour per cluster; unknown red; what is not the part has the background's grey.
cv::Mat draw_regions(const Regions& regions, unsigned char background = 0);
cv::Vec3b cluster_colour(std::size_t index);  ///< BGR

/// largest_scores() of one light, blue darker, red lighter, full colour at the limit, grey where
/// nothing was looked at; a numbered ring around each defect, the first is 1.
cv::Mat draw_defect_scores(const cv::Mat1f& scores, double limit, const DefectBlocks& blocks,
                           const std::vector<Defect>& defects, int width_px);

/// A sphere of the material under a frontal and a grazing point light (thesis, contribution C.I),
/// orthographic view, sRGB.
cv::Mat render_sphere(const Brdf& brdf, int side_px);

PartPictures draw(const Inspection& inspection, const Inspector& inspector);

/// Writes <dir>/{light1,light2,regions,residual,spheres}.png and returns the paths. Creates dir.
/// Throws InputError where it cannot write.
std::vector<std::filesystem::path> write_pictures(const std::filesystem::path& dir,
                                                  const PartPictures& pictures);

}  // namespace brdfgate
