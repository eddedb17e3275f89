// Cameras with a tone curve: the response recovered from a bracket, and the bracket merged with it
// (Debevec & Malik 1997; thesis, App. H sec. 3). For sensors that deliver linear counts the chain
// does not pass here.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "model/radiance.hpp"

namespace brdfgate {

/// One channel's inverse response. X = radiance times exposure time, in units of the X that gives
/// the middle count.
struct ToneCurve {
  std::vector<double> log_x;  ///< ln X by count, rising
  std::vector<double> sigma;  ///< standard deviation of ln X of one sample, by count
  int least = 0, most = 0;    ///< counts that carry information; the others are clipped

  int levels() const { return static_cast<int>(log_x.size()); }
};

struct ToneCurveSettings {
  int levels = 256;         ///< counts 0..levels - 1
  double margin = 0.02;     ///< share of the range at each end taken as clipped
  double black = 0;         ///< where the range begins
  double top = 0;           ///< where it ends; 0: at the last count
  double smoothness = 100;  ///< weight of g'' against one well exposed sample per count
};

/// The images of one bracket, one channel, CV_8UC1 or CV_16UC1, with their exposure times times
/// gain. Least squares of g(z_ij) = ln E_i + ln t_j over all pixels, the E_i eliminated, with
/// smoothness of g and weights by each count's own scatter, found by iteration; then made
/// monotonic. Throws InputError: under two exposures, unequal sizes, counts beyond the levels,
/// times not positive or all the same, too few pixels that are well exposed twice.
ToneCurve recover_tone_curve(const std::vector<cv::Mat>& images, const std::vector<double>& times_s,
                             const ToneCurveSettings& settings = {});

/// One image or more. Radiance (X per second) with variance: the mean of X_j / t_j with weights of
/// inverse variance, sigma taken at the count that the estimate predicts, iterated. Mask: kClipped
/// where every sample is above `most`, kNoiseFloor where every one is below `least`; both where
/// samples jump across.
Radiance merge_toned(const std::vector<cv::Mat>& images, const std::vector<double>& times_s,
                     const ToneCurve& curve);

}  // namespace brdfgate
