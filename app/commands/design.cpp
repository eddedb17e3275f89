// brdfgate design: where to put camera and lights, and what a given rig is worth.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "app/commands/commands.hpp"
#include "app/commands/design_commands.hpp"
#include "app/design_directions.hpp"
#include "app/design_drawing.hpp"
#include "app/design_report.hpp"
#include "app/number_text.hpp"
#include "app/progress.hpp"
#include "app/session.hpp"
#include "model/error.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr double kDegree = std::numbers::pi / 180;

/// A progress bar that any thread may advance.
class SharedProgress {
 public:
  SharedProgress(const std::string& label, int steps) : progress_(label, steps) {}
  void advance() {
    const std::lock_guard lock(mutex_);
    progress_.advance();
  }

 private:
  std::mutex mutex_;
  Progress progress_;
};

/// Options of every design that is searched for or scored.
struct DesignOptions {
  SessionOptions session;
  int components = 0;
  double eta = kRidgeEta;
  double beta = 0;
  std::string criterion = "error";
  SearchOptions search;
  double max_theta_deg = 85;
  double clearance_deg = 10;

  void add_to(CLI::App& command);
  DesignGoal goal() const {
    return {criterion == "error" ? DesignCriterion::error : DesignCriterion::condition, beta};
  }
  DesignLimits limits() const { return {max_theta_deg * kDegree, clearance_deg * kDegree}; }
  DesignBasis open_basis() const {
    return make_design_basis(Basis::open(load_config(session).files.basis), components, eta);
  }
  DesignSummary summary(const std::string& kind, const DesignBasis& basis, const DesignScore& score,
                        const std::vector<double>& costs) const;
};

void DesignOptions::add_to(CLI::App& command) {
  session.add_to(command);
  command.add_option("--basis", session.basis, "reflectance basis instead of the configuration's");
  command.add_option("--criterion", criterion, "what the search minimises")
      ->check(CLI::IsMember({"error", "condition"}))
      ->capture_default_str();
  command.add_option("--beta", beta, "error common to all directions, mapped units (C.VI eq. 15)")
      ->capture_default_str();
  command.add_option("--eta", eta, "ridge parameter")->capture_default_str();
  command.add_option("--components", components, "leading components to use; 0: all of the basis")
      ->capture_default_str();
  command.add_option("--starts", search.starts, "random starts of the search")
      ->capture_default_str();
  command.add_option("--candidates", search.candidates, "candidates for each new position")
      ->capture_default_str();
  command.add_option("--seed", search.seed, "of the random starts")->capture_default_str();
}

DesignSummary DesignOptions::summary(const std::string& kind, const DesignBasis& basis,
                                     const DesignScore& score,
                                     const std::vector<double>& costs) const {
  DesignSummary s;
  s.kind = kind;
  s.basis = load_config(session).files.basis.string();
  s.goal = goal();
  s.score = score;
  s.unmeasured = expected_error(basis, Information::none(basis.components())).total(goal().beta);
  s.costs = costs;
  s.seed = search.seed;
  s.components = static_cast<int>(basis.components());
  s.eta = eta;
  return s;
}

/// Runs a search under a progress bar.
template <typename Search>
auto with_progress(const SearchOptions& options, Search&& search) {
  SharedProgress progress("searching", options.starts);
  SearchOptions watched = options;
  watched.started = [&progress] { progress.advance(); };
  return search(watched);
}

template <typename Design>
void print_design(const DesignSummary& summary, bool as_json, const char* key,
                  const json& positions, Design&& print_positions) {
  if (as_json) {
    json document = to_json(summary);
    document[key] = positions;
    fmt::print("{}\n", document.dump(2));
    return;
  }
  print_positions();
  print(summary);
}

// ---- near-field cameras

struct ViewOptions {
  double distance_mm = 180;
  double fov_deg = 25;
  double light_distance_mm = 0;
  int samples = 15;
  fs::path out_svg;

  void add_to(CLI::App& command) {
    command.add_option("--distance-mm", distance_mm, "camera to the sample's centre")
        ->capture_default_str();
    command.add_option("--fov-deg", fov_deg, "full angle under which the disc is seen from above")
        ->capture_default_str();
    command
        .add_option("--light-distance-mm", light_distance_mm,
                    "lights to the sample's centre; 0: parallel light")
        ->capture_default_str();
    command.add_option("--samples", samples, "points across the disc")->capture_default_str();
    command.add_option("--out-svg", out_svg, "drawing to write: side view, top view, positions");
  }
  NearField view() const {
    constexpr double kMetres = 1e-3;
    return {distance_mm * kMetres, fov_deg * kDegree, light_distance_mm * kMetres, samples};
  }
};

std::string light_note(const CameraLight& image) {
  const HalfDiff c = centre_of(image);
  return fmt::format("centre: theta_h {:.1f}, theta_d {:.1f}, phi_d {:.1f}", c.theta_h / kDegree,
                     c.theta_d / kDegree, c.phi_d / kDegree);
}

RigDrawing drawing_of(const std::vector<CameraLight>& images, const NearField& view,
                      const DesignSummary& summary) {
  RigDrawing drawing;
  drawing.title = summary.kind == "rig" ? "Fixed camera, each light on in turn"
                                        : "Free camera: one camera and one light per image";
  drawing.note = fmt::format("Expected error {:.3f} mapped RMS (unmeasured {:.3f}), {} directions",
                             summary.score.error.total(summary.goal.beta), summary.unmeasured,
                             summary.score.rows);
  drawing.disc_radius_m = view.disc_radius();
  drawing.fov = view.fov;
  for (std::size_t i = 0; i < images.size(); ++i) {
    const bool fixed = summary.kind == "rig";
    if (i == 0 || !fixed) {
      const std::string label = fixed ? "Camera" : fmt::format("Camera {}", i + 1);
      drawing.parts.push_back({label, true, images[i].camera, view.distance, "aims at the centre"});
    }
    drawing.parts.push_back({fmt::format("Light {}", i + 1), false, images[i].light,
                             view.light_distance, light_note(images[i])});
  }
  return drawing;
}

void finish_images(const DesignSummary& summary, const std::vector<CameraLight>& images,
                   const ViewOptions& options, bool as_json) {
  const NearField view = options.view();
  if (!options.out_svg.empty()) {
    write_text(options.out_svg, draw_rig_svg(drawing_of(images, view, summary)));
  }
  json positions = to_json(images, view);
  print_design(summary, as_json, "images", positions, [&] { print(images, view); });
}

/// One direction an occurrence of the option, so that two half-written ones are not taken for one.
std::vector<PolarDirection> polar_directions(const std::vector<std::string>& texts,
                                             const char* option) {
  std::vector<PolarDirection> directions;
  for (const std::string_view text : texts) {
    const std::size_t comma = std::min(text.find(','), text.size());
    const auto theta_deg = finite_number(text.substr(0, comma));
    const auto phi_deg = finite_number(text.substr(std::min(comma + 1, text.size())));
    if (!theta_deg || !phi_deg) {
      throw InputError(option, "'" + std::string(text) + "'",
                       "angle from the normal and azimuth in degrees, such as 20,180");
    }
    directions.push_back({*theta_deg * kDegree, *phi_deg * kDegree});
  }
  return directions;
}

void add_limits(CLI::App& command, DesignOptions& options, bool clearance) {
  command
      .add_option("--max-theta-deg", options.max_theta_deg,
                  "camera and lights no farther from the normal")
      ->capture_default_str();
  if (clearance) {
    command
        .add_option("--clearance-deg", options.clearance_deg,
                    "least angle between camera and light, seen from the sample")
        ->capture_default_str();
  }
}

}  // namespace

void write_text(const fs::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text;
  if (!out.flush()) throw InputError(file, "cannot be written", "a place to write to");
}

void add_design_points(CLI::App& design, int& exit_code) {
  struct Options : DesignOptions {
    int n = 5;
    fs::path from, out;
  };
  auto options = std::make_shared<Options>();
  CLI::App* command = design.add_subcommand("points", "n single directions (a goniometer)");
  command->add_option("--n", options->n, "directions to choose")->capture_default_str();
  command->add_option("--from", options->from, "score the directions of this CSV instead");
  command->add_option("--out", options->out, "CSV of the directions, for `design path`");
  options->add_to(*command);
  add_limits(*command, *options, false);
  command->callback([options, &exit_code] {
    const DesignBasis basis = options->open_basis();
    Found<std::vector<HalfDiff>> found;
    if (!options->from.empty()) {
      found.design = read_directions(options->from);
    } else {
      found = with_progress(options->search, [&](const SearchOptions& search) {
        return design_points(basis, options->n, options->goal(), options->limits(), search);
      });
    }
    if (!options->out.empty()) write_text(options->out, directions_csv(found.design));
    const DesignSummary summary =
        options->summary("points", basis, score_points(basis, found.design), found.costs);
    print_design(summary, options->session.json, "points", to_json(found.design),
                 [&] { print(found.design); });
    exit_code = kExitYes;
  });
}

void add_design_spheres(CLI::App& design, int& exit_code) {
  struct Options : DesignOptions {
    int n = 2;
    std::vector<int> theta_d;
  };
  auto options = std::make_shared<Options>();
  CLI::App* command = design.add_subcommand("spheres", "n images of a sphere of the material");
  command->add_option("--n", options->n, "images to choose")->capture_default_str();
  command
      ->add_option("--theta-d", options->theta_d,
                   "score these instead: half the angle between camera and light, whole degrees")
      ->delimiter(',')
      ->check(CLI::Range(0, 89));
  options->add_to(*command);
  command->callback([options, &exit_code] {
    const DesignBasis basis = options->open_basis();
    constexpr int kSlices = 90;
    SharedProgress progress("looking at spheres", kSlices);
    const std::vector<Information> images =
        sphere_images(basis, [&progress] { progress.advance(); });
    Found<std::vector<int>> found;
    if (!options->theta_d.empty()) {
      found.design = options->theta_d;
    } else {
      found = with_progress(options->search, [&](const SearchOptions& search) {
        return design_spheres(basis, images, options->n, options->goal(), search);
      });
    }
    Information all = Information::none(basis.components());
    for (const int d : found.design)
      all += images[static_cast<std::size_t>(d)];
    const DesignSummary summary =
        options->summary("spheres", basis, score(basis, all), found.costs);
    print_design(summary, options->session.json, "theta_d_deg", found.design, [&] {
      fmt::print("image  theta_d  between camera and light (deg)\n");
      int n = 0;
      for (const int d : found.design)
        fmt::print("{:5}  {:7}  {:7}\n", ++n, d, 2 * d);
    });
    exit_code = kExitYes;
  });
}

void add_design_camera(CLI::App& design, int& exit_code) {
  struct Options : DesignOptions, ViewOptions {
    int n = 2;
  };
  auto options = std::make_shared<Options>();
  CLI::App* command = design.add_subcommand(
      "camera", "n near-field images of a flat sample, camera and light free in each");
  command->add_option("--n", options->n, "images to choose")->capture_default_str();
  options->DesignOptions::add_to(*command);
  options->ViewOptions::add_to(*command);
  add_limits(*command, *options, true);
  command->callback([options, &exit_code] {
    const DesignBasis basis = options->open_basis();
    const NearField view = options->view();
    const auto found = with_progress(options->search, [&](const SearchOptions& search) {
      return design_free_camera(basis, view, options->n, options->goal(), options->limits(),
                                search);
    });
    const DesignSummary summary =
        options->summary("camera", basis, score_images(basis, view, found.design), found.costs);
    finish_images(summary, found.design, *options, options->session.json);
    exit_code = kExitYes;
  });
}

void add_design_rig(CLI::App& design, int& exit_code) {
  struct Options : DesignOptions, ViewOptions {
    int lights = 2;
    std::optional<double> camera_deg;
    std::vector<std::string> light;
  };
  auto options = std::make_shared<Options>();
  CLI::App* command = design.add_subcommand(
      "rig", "near-field images of a flat sample by one fixed camera under n lights");
  command->add_option("--lights", options->lights, "lights to place")->capture_default_str();
  command->add_option("--camera-deg", options->camera_deg,
                      "camera stays at this angle from the normal");
  command
      ->add_option("--light", options->light,
                   "score a rig with this light instead: angle from the normal, azimuth from the "
                   "camera's, such as 20,180; once per light; needs --camera-deg")
      ->allow_extra_args(false);
  options->DesignOptions::add_to(*command);
  options->ViewOptions::add_to(*command);
  add_limits(*command, *options, true);
  command->callback([options, &exit_code] {
    const DesignBasis basis = options->open_basis();
    const NearField view = options->view();
    std::optional<double> camera;
    if (options->camera_deg) camera = *options->camera_deg * kDegree;
    Found<FixedRig> found;
    if (!options->light.empty()) {
      if (!camera) throw InputError("--light", "needs --camera-deg", "the camera's angle too");
      found.design = {*camera, polar_directions(options->light, "--light")};
    } else {
      found = with_progress(options->search, [&](const SearchOptions& search) {
        return design_fixed_rig(basis, view, {options->lights, camera}, options->goal(),
                                options->limits(), search);
      });
    }
    const std::vector<CameraLight> images = images_of(found.design);
    const DesignSummary summary =
        options->summary("rig", basis, score_images(basis, view, images), found.costs);
    finish_images(summary, images, *options, options->session.json);
    exit_code = kExitYes;
  });
}

void add_design(CLI::App& tool, int& exit_code) {
  CLI::App* design = tool.add_subcommand(
      "design", "where to put camera and lights, and what a given rig is worth");
  design->require_subcommand(1);
  add_design_points(*design, exit_code);
  add_design_spheres(*design, exit_code);
  add_design_camera(*design, exit_code);
  add_design_rig(*design, exit_code);
  add_design_path(*design, exit_code);
}

}  // namespace brdfgate
