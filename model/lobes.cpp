#include "model/lobes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include "model/error.hpp"
#include "model/lobe_formulas.hpp"

namespace brdfgate {
namespace {

constexpr double kPi = lobe::kPi;

// Priors of the fits: medians and spreads wide enough for everything from matt to polished (a
// factor of e^2 either way is two deviations for the levels). In mapped units levels below 1e-5 do
// not differ from none (epsilon is 1e-3).
constexpr LobeParameter kDiffuse{"diffuse", 0, 1, false, 0.1, 1.5, false, 1e-6, 1};
constexpr LobeParameter kReflectance{"specular", 0, 1, false, 0.1, 1.5, false, 1e-6, 1};
constexpr LobeParameter kF0{"f0", 0, 1, false, 0.05, 1.5, false, 1e-6, 1};
/// k_s of C.I: (s + 2) / (2 pi) of a Phong exponent, free of a bound.
constexpr LobeParameter kLevel{"specular", 0, 1e9, false, 10, 3, false, 1e-6, 1e8};
constexpr std::array kExponent{LobeParameter{"exponent", 0, 1e7, true, 60, 2, false, 0.3, 1e6}};
constexpr std::array kRoughness{LobeParameter{"alpha", 0, 1, true, 0.15, 1, false, 1e-3, 1}};
constexpr std::array kBlend{LobeParameter{"exponent", 0, 1e7, true, 60, 2, false, 0.3, 1e6},
                            LobeParameter{"alpha", 0, 1, false, 0.5, 0.5, true, 0, 1},
                            LobeParameter{"ior", 1, 1000, true, 1.5, 0.3, false, 1.02, 20}};

constexpr std::array kExponentStarts{4.0, 30.0, 250.0, 2000.0};
constexpr std::array kRoughnessStarts{0.5, 0.2, 0.08, 0.03};

constexpr std::array kModels{LobeModel::lambert, LobeModel::phong, LobeModel::blinn_phong,
                             LobeModel::ward,    LobeModel::ggx,   LobeModel::beckmann,
                             LobeModel::blend};

const std::array<LobeDescription, 7>& descriptions() {
  static const std::array<LobeDescription, 7> all{
      {{LobeModel::lambert, "lambert", kReflectance, {}, {}},
       {LobeModel::phong, "phong", kReflectance, kExponent, kExponentStarts},
       {LobeModel::blinn_phong, "blinn_phong", kReflectance, kExponent, kExponentStarts},
       {LobeModel::blend, "blend", kLevel, kBlend, kExponentStarts},
       {LobeModel::ward, "ward", kReflectance, kRoughness, kRoughnessStarts},
       {LobeModel::ggx, "ggx", kF0, kRoughness, kRoughnessStarts},
       {LobeModel::beckmann, "beckmann", kF0, kRoughness, kRoughnessStarts}}};
  return all;
}

std::string field(LobeModel model, std::string_view parameter) {
  const std::string name(describe(model).name);
  return model == LobeModel::lambert ? name : name + "." + std::string(parameter);
}

void check_range(LobeModel model, const LobeParameter& parameter, double value) {
  const bool high_enough = parameter.above_least ? value > parameter.least  //
                                                 : value >= parameter.least;
  if (high_enough && value <= parameter.most) return;
  throw InputError(field(model, parameter.name), std::to_string(value),
                   (parameter.above_least ? "over " : "at least ") +
                       std::to_string(parameter.least) + " and at most " +
                       std::to_string(parameter.most));
}

void check(const Lobe& lobe) {
  const LobeDescription& description = describe(lobe.model);
  for (const double value : lobe.diffuse)
    check_range(lobe.model, kDiffuse, value);
  if (lobe.shape.size() != description.shape.size()) {
    throw InputError(std::string(description.name),
                     std::to_string(lobe.shape.size()) + " shape parameters",
                     std::to_string(description.shape.size()));
  }
  if (lobe.model == LobeModel::lambert) return;
  for (const double value : lobe.specular)
    check_range(lobe.model, description.specular, value);
  for (std::size_t i = 0; i < lobe.shape.size(); ++i)
    check_range(lobe.model, description.shape[i], lobe.shape[i]);
}

class Lambert final : public Brdf {
 public:
  explicit Lambert(const Rgb& albedo) : diffuse_(albedo / kPi) {}
  Rgb diffuse(double /*theta_d*/) const override { return diffuse_; }
  Rgb specular(const HalfDiff& /*angles*/) const override { return Rgb::Zero(); }

 private:
  Rgb diffuse_;
};

template <typename Formula>
class OneLobe final : public Brdf {
 public:
  explicit OneLobe(const Lobe& lobe) : diffuse_(lobe.diffuse / kPi), specular_(lobe.specular) {
    std::copy_n(lobe.shape.begin(), Formula::kShapes, shape_.begin());
  }
  Rgb diffuse(double /*theta_d*/) const override { return diffuse_; }
  Rgb specular(const HalfDiff& angles) const override {
    const Cosines c = cosines(angles);
    if (!c.above_horizon()) return Rgb::Zero();
    const auto value = Formula::template eval<double>(shape_.data(), lobe::geometry(angles, c));
    return value.offset + value.gain * specular_;
  }

 private:
  Rgb diffuse_;
  Rgb specular_;
  std::array<double, Formula::kShapes> shape_;
};

}  // namespace

std::span<const LobeModel> lobe_models() {
  return kModels;
}

const LobeDescription& describe(LobeModel model) {
  return descriptions()[static_cast<std::size_t>(model)];
}

const LobeParameter& diffuse_parameter() {
  return kDiffuse;
}

LobeModel lobe_model(std::string_view name) {
  std::string names;
  for (const LobeModel model : kModels) {
    const std::string_view known = describe(model).name;
    if (known == name) return model;
    names += (names.empty() ? "" : ", ") + std::string(known);
  }
  throw InputError("model", "'" + std::string(name) + "' is unknown", "one of " + names);
}

BrdfPtr make_brdf(const Lobe& lobe) {
  check(lobe);
  if (lobe.model == LobeModel::lambert) return std::make_shared<Lambert>(lobe.diffuse);
  return lobe::with_formula(lobe.model, [&](auto formula) -> BrdfPtr {
    return std::make_shared<OneLobe<decltype(formula)>>(lobe);
  });
}

}  // namespace brdfgate
