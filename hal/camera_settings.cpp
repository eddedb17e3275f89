#include "hal/camera_settings.hpp"

#include <cmath>

namespace brdfgate {

double GainLaw::gain_of(double code) const {
  switch (kind) {
    case Kind::linear:
      return code / scale;
    case Kind::decibel:
      return std::pow(10.0, code * scale / 20);
    case Kind::reciprocal:
      return scale / (scale - code);
  }
  return 1;
}

double GainLaw::code_of(double gain) const {
  switch (kind) {
    case Kind::linear:
      return gain * scale;
    case Kind::decibel:
      return 20 * std::log10(gain) / scale;
    case Kind::reciprocal:
      return scale - scale / gain;
  }
  return 0;
}

}  // namespace brdfgate
