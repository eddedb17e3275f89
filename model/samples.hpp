// Angular bins: many pixels of one material averaged, in linear reflectance, into few observations.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "model/directions.hpp"

namespace brdfgate {

/// One light's pixels of one cluster that share a small range of (theta_h, theta_d, phi_d).
struct Bin {
  int id = 0;       ///< of the station's bin grid: the same bin for every part
  int light = 0;    ///< 1 or 2
  HalfDiff angles;  ///< mean over the bin's pixels
  int pixels = 0;
  Eigen::Array3d f = Eigen::Array3d::Zero();  ///< mean reflectance, 1/sr (mono: [0] only)
  Eigen::Array3d variance =
      Eigen::Array3d::Zero();  ///< of that mean, from the propagated pixel noise
};

/// All observations of one cluster, both lights.
struct BinnedSamples {
  int channels = 3;
  std::vector<Bin> bins;

  std::vector<HalfDiff> directions() const {
    std::vector<HalfDiff> d;
    d.reserve(bins.size());
    for (const Bin& b : bins)
      d.push_back(b.angles);
    return d;
  }
};

}  // namespace brdfgate
