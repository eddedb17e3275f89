// brdfgate design path: a robot's way over chosen directions, to measure a reference BRDF.
#include <fmt/core.h>

#include <memory>
#include <numbers>

#include "app/commands/design_commands.hpp"
#include "app/design_directions.hpp"
#include "app/design_report.hpp"
#include "app/session.hpp"

namespace brdfgate {
namespace {

namespace fs = std::filesystem;

/// Defaults: the robot of Appendix G; clearance and longest move are ours.
struct PathOptions {
  fs::path from;
  fs::path out;
  double radius_mm = 350;
  std::vector<double> centre_mm{0, 0, 0};
  double arc_azimuth_deg = 90;
  double lamp_step_deg = 7.5;
  double max_theta_deg = 82.5;
  double clearance_deg = 10;
  double longest_move_deg = 15;
  bool json = false;

  void add_to(CLI::App& command);
  Goniometer goniometer() const {
    constexpr double kDegree = std::numbers::pi / 180;
    constexpr double kMetres = 1e-3;
    Goniometer g;
    g.centre = kMetres * Eigen::Vector3d(centre_mm[0], centre_mm[1], centre_mm[2]);
    g.camera_radius = kMetres * radius_mm;
    g.arc_azimuth = kDegree * arc_azimuth_deg;
    g.lamp_step = kDegree * lamp_step_deg;
    g.max_theta = kDegree * max_theta_deg;
    g.clearance = kDegree * clearance_deg;
    g.longest_move = kDegree * longest_move_deg;
    return g;
  }
};

void PathOptions::add_to(CLI::App& command) {
  command.add_option("--from", from, "CSV of directions, as `design points --out` writes it")
      ->required();
  command.add_option("--out", out, "CSV of the stops to write");
  command.add_option("--radius-mm", radius_mm, "camera to the sample's centre")
      ->capture_default_str();
  command.add_option("--centre-mm", centre_mm, "the sample's centre in the robot's frame")
      ->delimiter(',')
      ->expected(3)
      ->capture_default_str();
  command.add_option("--arc-azimuth-deg", arc_azimuth_deg, "of the lamps in the robot's frame")
      ->capture_default_str();
  command.add_option("--lamp-step-deg", lamp_step_deg, "between neighbouring lamps on the arc")
      ->capture_default_str();
  command
      .add_option("--max-theta-deg", max_theta_deg, "camera and lamps no farther from the normal")
      ->capture_default_str();
  command
      .add_option("--clearance-deg", clearance_deg,
                  "least angle between camera and lamp: the camera casts a shadow")
      ->capture_default_str();
  command.add_option("--longest-move-deg", longest_move_deg, "longer moves get stops on the way")
      ->capture_default_str();
  command.add_flag("--json", json, "print one JSON document on stdout");
}

}  // namespace

void add_design_path(CLI::App& design, int& exit_code) {
  auto options = std::make_shared<PathOptions>();
  CLI::App* command =
      design.add_subcommand("path", "a robot's way over chosen directions (App. G)");
  options->add_to(*command);
  command->callback([options, &exit_code] {
    const GoniometerPath path = plan_path(options->goniometer(), read_directions(options->from));
    if (!options->out.empty()) write_text(options->out, path_csv(path));
    if (options->json) {
      fmt::print("{}\n", to_json(path).dump(2));
    } else {
      print(path);
    }
    exit_code = kExitYes;
  });
}

}  // namespace brdfgate
