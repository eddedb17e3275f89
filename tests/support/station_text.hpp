// A station file that every rule of the reader accepts: the shape of config/station.yaml, with
// figures that stay while the shipped file's are tuned.
#pragma once

namespace brdfgate::test {

inline constexpr const char* kStationText = R"(# station
station: simulated bench

camera:
  backend: simulated
  sensor:
    width: 1456
    height: 1088
    bits: 10
    mosaic: rggb
    black_level_dn: 60
    full_well_dn: 1023
    gain_dn_per_electron: 0.0963
    read_noise_dn: 0.3
  bracket_ms: [0.03, 0.4, 5, 60]
  ambient_ms: [5, 60]
  gain: 1
  frame_timeout_ms: 1000
  scenes: [scenes/good.yaml, scenes/stain.yaml]
  seed: 1

rig:
  camera: {theta_deg: 55, distance_mm: 180}
  field_of_view_deg: 25
  lights:
    - {theta_deg: 55, phi_deg: 180, distance_mm: 300}
    - {theta_deg: 20, phi_deg: 0, distance_mm: 300}

simulator:
  full_well_e: 10000
  dark_current_e_s: 5
  line_time_us: 14.8
  vignetting: 0.15
  led_radius_mm: 0.5
  white_exposure_ms: 8

inspection:
  region_mm: [90, 90]
  fixture: {albedo: [0.01, 0.25, 0.40], tolerance: 0.25}
  max_clusters: 8
  method: ridge
  eta: 40
  fixture_tilt_sigma_deg: 0.3
  colour: linear_srgb_d65

judge:
  false_reject_rate: 0.001
  change_floor: 0.002
  colour_limit_de00: 1.5
  gloss_limit_gu: 8
  area_share_limit: 0.03
  unknown_share_limit: 0.002
  assign_tolerance: 0.45
  defect_log_threshold: 0.2
  defect_min_mm2: 1.0
  max_ambient: 0.05
  max_clipped: 0.02
  min_coverage: 0.25
  min_bins: 20

plc:
  tcp:
    enabled: true
    bind: 127.0.0.1
    port: 1502
    allow: []
    max_clients: 8
    request_deadline_ms: 2000
    idle_timeout_s: 60
  unit_id: 1
  word_order: abcd
  handshake_timeout_s: 10
  heartbeat_timeout_s: 0

files:
  basis: basis/merl.basis
  calibration: station.calibration.exr
  recipes: []
  state_dir: /var/tmp/brdfgate
)";

}  // namespace brdfgate::test
