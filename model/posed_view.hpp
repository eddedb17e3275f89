// What cells see of a part that lies otherwise than taught: Sightline for a whole image, in single
// precision and with everything that is the same for all cells taken out.
#pragma once

#include <opencv2/core.hpp>

#include "model/pose.hpp"

namespace brdfgate {

class PosedView {
 public:
  /// @param light  index into taught.lights_W
  PosedView(const StationGeometry& taught, std::size_t light, const PartPose& pose);

  struct Seen {
    cv::Vec3f angles;    ///< theta_h, theta_d, phi_d on the part, rad
    float gain = 0;      ///< irradiance as taught over that on the part (App. H eq. 20)
    bool above = false;  ///< camera and light are above the part's horizon; else nothing is seen
  };
  /// @param at  point of the taught plane z = 0 that the cell looks at, m
  Seen see(const cv::Vec2f& at) const;

 private:
  Eigen::Vector3f light_W_;
  Eigen::Matrix3f R_PW_;
  Eigen::Vector3f t_PW_;
  Eigen::Vector3f eye_P_;
  Eigen::Vector3f light_P_;
};

}  // namespace brdfgate
