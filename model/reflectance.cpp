#include "model/reflectance.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "model/error.hpp"

namespace brdfgate {
namespace {

std::string layout(const cv::Mat& m) {
  return std::to_string(m.cols) + " x " + std::to_string(m.rows) + " cells of " +
         std::to_string(m.channels()) + " channels";
}

void check_layout(const std::string& where, const cv::Mat& seen, const cv::Mat& reference) {
  if (seen.size() != reference.size() || seen.type() != reference.type()) {
    throw InputError(where, layout(seen), layout(reference) + " as calibrated");
  }
}

/// cos_i / d^2 of a light over a surface of this normal through p; not positive below its horizon.
double irradiance_factor(const Eigen::Vector3d& light_W, const Eigen::Vector3d& p_W,
                         const Eigen::Vector3d& normal_W) {
  const Eigen::Vector3d d = light_W - p_W;
  const double square = d.squaredNorm();
  return normal_W.dot(d) / (square * std::sqrt(square));
}

/// App. H eq. 20 beyond the signal ratio, along one ray from the eye (of any length):
/// (cos_i_ref / cos_i_mat) (d_mat / d_ref)^2 for the points of z = 0 and of the part's plane that
/// it meets; 0 where either is out of sight of camera or light.
double ray_factor(const Eigen::Vector3d& light_W, const Eigen::Vector3d& eye_W,
                  const Eigen::Vector3d& ray_W, const PartPlane& plane) {
  const Eigen::Vector3d normal_W = plane.normal_W();
  const double to_part =
      normal_W.dot(Eigen::Vector3d(0, 0, plane.height_m) - eye_W) / normal_W.dot(ray_W);
  const double to_reference = -eye_W.z() / ray_W.z();
  if (!(to_part > 0 && to_reference > 0)) return 0;
  const double part = irradiance_factor(light_W, eye_W + to_part * ray_W, normal_W);
  const double reference =
      irradiance_factor(light_W, eye_W + to_reference * ray_W, Eigen::Vector3d::UnitZ());
  return part > 0 && reference > 0 ? reference / part : 0;
}

cv::Mat plane_factor(const Calibration& calibration, std::size_t light, const PartPlane& plane) {
  const PinholeCamera& camera = calibration.geometry.camera;
  const Eigen::Vector3d light_W = calibration.geometry.lights_W[light];
  const Eigen::Vector3d eye_W = camera.position();
  cv::Mat factor(calibration.sensor.cells(), CV_32FC1);
  cv::parallel_for_(cv::Range(0, factor.rows), [&](const cv::Range& rows) {
    for (int v = rows.start; v < rows.end; ++v) {
      auto* row = factor.ptr<float>(v);
      for (int u = 0; u < factor.cols; ++u) {
        const Eigen::Vector3d ray_W = camera.ray_W(cell_centre_px(calibration.sensor, u, v));
        row[u] = static_cast<float>(ray_factor(light_W, eye_W, ray_W, plane));
      }
    }
  });
  return factor;
}

/// Rows of one cell row: part, reference and the output, walked together.
struct RowView {
  const float *x, *x_variance, *reference, *reference_variance, *factor;
  float *f, *f_variance;
  const unsigned char *x_mask, *reference_mask;
  unsigned char* mask;
};

RowView row_view(const Radiance& part, const Radiance& white, const cv::Mat& factor,
                 Reflectance& out, int v) {
  RowView row{};
  row.x = part.value.ptr<float>(v);
  row.x_variance = part.variance.ptr<float>(v);
  row.reference = white.value.ptr<float>(v);
  row.reference_variance = white.variance.ptr<float>(v);
  row.factor = factor.empty() ? nullptr : factor.ptr<float>(v);
  row.f = out.value.ptr<float>(v);
  row.f_variance = out.variance.ptr<float>(v);
  row.x_mask = part.mask.ptr<unsigned char>(v);
  row.reference_mask = white.mask.ptr<unsigned char>(v);
  row.mask = out.mask.ptr<unsigned char>(v);
  return row;
}

template <int kChannels>
bool usable_reference(const RowView& row, int u) {
  if (row.reference_mask[u] != 0) return false;
  if (row.factor != nullptr && !(row.factor[u] > 0)) return false;
  for (int c = 0; c < kChannels; ++c) {
    if (!(row.reference[u * kChannels + c] > 0)) return false;
  }
  return true;
}

/// f = s X_mat / X_ref with s = rho_ref / pi times the geometry's factor;
/// var f = s^2 (var X_mat + (X_mat / X_ref)^2 var X_ref) / X_ref^2.
template <int kChannels>
void convert_cell(const RowView& row, const std::array<float, 3>& scale, int u) {
  if (!usable_reference<kChannels>(row, u)) {
    for (int i = u * kChannels; i < (u + 1) * kChannels; ++i)
      row.f[i] = row.f_variance[i] = 0;
    row.mask[u] = static_cast<unsigned char>(row.x_mask[u] | kInvalid);
    return;
  }
  const float factor = row.factor == nullptr ? 1.0F : row.factor[u];
  for (int c = 0; c < kChannels; ++c) {
    const int i = u * kChannels + c;
    const float per_reference = 1.0F / row.reference[i];
    const float ratio = row.x[i] * per_reference;
    const float to_f = scale[c] * factor;
    row.f[i] = to_f * ratio;
    row.f_variance[i] = to_f * to_f * per_reference * per_reference *
                        (row.x_variance[i] + ratio * ratio * row.reference_variance[i]);
  }
  row.mask[u] = row.x_mask[u];
}

template <int kChannels>
void convert(const Radiance& part, const Radiance& white, const cv::Mat& factor,
             const std::array<float, 3>& scale, Reflectance& out) {
  cv::parallel_for_(cv::Range(0, part.value.rows), [&](const cv::Range& rows) {
    for (int v = rows.start; v < rows.end; ++v) {
      const RowView row = row_view(part, white, factor, out, v);
      for (int u = 0; u < part.value.cols; ++u)
        convert_cell<kChannels>(row, scale, u);
    }
  });
}

Reflectance convert_light(const Radiance& part, const Calibration& calibration, std::size_t light,
                          const PartPlane& plane, const Eigen::Array3d& lamp) {
  const Radiance& white = calibration.white[light];
  check_layout("light " + std::to_string(light + 1), part.value, white.value);
  cv::Mat factor;
  if (!plane.in_reference_plane()) factor = plane_factor(calibration, light, plane);
  std::array<float, 3> scale{};
  for (std::size_t c = 0; c < scale.size(); ++c)
    scale[c] = static_cast<float>(calibration.white_reflectance[c] / std::numbers::pi /
                                  lamp[static_cast<Eigen::Index>(c)]);
  Reflectance out;
  out.value.create(part.value.size(), part.value.type());
  out.variance.create(part.value.size(), part.value.type());
  out.mask.create(part.value.size(), CV_8UC1);
  if (part.value.channels() == 1) {
    convert<1>(part, white, factor, scale, out);
  } else {
    convert<3>(part, white, factor, scale, out);
  }
  return out;
}

/// Ambient over what the reference would give with the reflectance that lies there, colours summed,
/// of the usable cells: of every second row and column, which are plenty for a median.
/// @param relative  reflectance over the reference's, per channel
std::vector<double> shares(const Radiance& ambient, const Radiance& white, const cv::Mat& cells,
                           const Eigen::Array3d& relative) {
  const int channels = ambient.value.channels();
  std::vector<double> out;
  out.reserve(cells.total() / 4 + static_cast<std::size_t>(cells.rows + cells.cols));
  for (int v = 0; v < cells.rows; v += 2) {
    const auto* in = cells.ptr<unsigned char>(v);
    const auto* bad = white.mask.ptr<unsigned char>(v);
    const auto* a = ambient.value.ptr<float>(v);
    const auto* w = white.value.ptr<float>(v);
    for (int u = 0; u < cells.cols; u += 2) {
      if (in[u] == 0 || bad[u] != 0) continue;
      double seen = 0;
      double expected = 0;
      for (int c = 0; c < channels; ++c) {
        seen += a[u * channels + c];
        expected += relative[c] * w[u * channels + c];
      }
      out.push_back(seen / expected);
    }
  }
  return out;
}

}  // namespace

Eigen::Vector3d PartPlane::normal_W() const {
  return Eigen::AngleAxisd(tilt.y(), Eigen::Vector3d::UnitY()) *
         (Eigen::AngleAxisd(tilt.x(), Eigen::Vector3d::UnitX()) * Eigen::Vector3d::UnitZ());
}

std::vector<Reflectance> to_reflectance(const RadianceSet& radiance, const Calibration& calibration,
                                        double height_m) {
  return to_reflectance(radiance, calibration, PartPlane{.height_m = height_m});
}

std::vector<Reflectance> to_reflectance(const RadianceSet& radiance, const Calibration& calibration,
                                        const PartPlane& plane,
                                        const std::vector<Eigen::Array3d>& lamps) {
  if (radiance.lights.size() != calibration.white.size() ||
      (!plane.in_reference_plane() &&
       calibration.geometry.lights_W.size() != calibration.white.size())) {
    throw InputError("capture", std::to_string(radiance.lights.size()) + " lights",
                     std::to_string(calibration.white.size()) + " as calibrated");
  }
  std::vector<Reflectance> out;
  for (std::size_t l = 0; l < radiance.lights.size(); ++l) {
    const Eigen::Array3d lamp = lamps.empty() ? Eigen::Array3d::Ones() : lamps.at(l);
    if (!(lamp > 0).all()) {
      throw InputError("light " + std::to_string(l + 1), "gives no light", "a level over 0");
    }
    out.push_back(convert_light(radiance.lights[l], calibration, l, plane, lamp));
  }
  return out;
}

double ambient_share(const Radiance& ambient, const Calibration& calibration, const cv::Mat& cells,
                     const Eigen::Array3d& reflectance) {
  if (calibration.white.size() < 2) {
    throw InputError("calibration", std::to_string(calibration.white.size()) + " lights",
                     "a white reference under light 2");
  }
  const Radiance& white = calibration.white[1];
  check_layout("ambient frame", ambient.value, white.value);
  if (cells.size() != white.value.size() || cells.type() != CV_8UC1) {
    throw InputError("inspected region", layout(cells), layout(white.mask));
  }
  const Eigen::Map<const Eigen::Array3d> reference(calibration.white_reflectance.data());
  if (!(reflectance > 0).all()) {
    throw InputError("reflectance under ambient light", "not positive", "over 0 per channel");
  }
  std::vector<double> all = shares(ambient, white, cells, reflectance / reference);
  if (all.empty()) {
    throw InputError("inspected region", "no cell with a white reference under light 2",
                     "a calibrated region");
  }
  const auto middle = all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2);
  std::nth_element(all.begin(), middle, all.end());
  return *middle;
}

}  // namespace brdfgate
