#include "config/sensor_yaml.hpp"

namespace brdfgate {
namespace {

const std::vector<std::string>& mosaic_names() {
  static const std::vector<std::string> names{"mono", "rggb", "bggr", "grbg", "gbrg"};
  return names;
}

/// A mosaic's cell is 2x2 pixels: the measured image has no half cells.
int read_side(const YamlNode& node, std::string_view key, Mosaic mosaic) {
  const int side = node.integer(key, 2, 16384);
  if (mosaic != Mosaic::mono && side % 2 != 0) {
    node.fail_at(key, std::to_string(side) + " pixels with a mosaic of 2x2 cells",
                 "an even number");
  }
  return side;
}

}  // namespace

const std::string& mosaic_name(Mosaic mosaic) {
  return mosaic_names().at(static_cast<std::size_t>(mosaic));
}

SensorFormat read_sensor_format(const YamlNode& node, std::string_view black_level_key) {
  SensorFormat sensor;
  sensor.mosaic = static_cast<Mosaic>(node.choice("mosaic", mosaic_names()));
  sensor.width = read_side(node, "width", sensor.mosaic);
  sensor.height = read_side(node, "height", sensor.mosaic);
  sensor.bits = node.integer("bits", 8, 16);
  const double top = (1 << sensor.bits) - 1;
  sensor.full_well_dn = node.number("full_well_dn");
  if (sensor.full_well_dn <= 0 || sensor.full_well_dn > top) {
    node.fail_at(
        "full_well_dn",
        number_text(sensor.full_well_dn) + " with " + std::to_string(sensor.bits) + " bits",
        "above 0 and at most " + number_text(top));
  }
  sensor.black_level_dn = node.number(black_level_key);
  if (sensor.black_level_dn < 0 || sensor.black_level_dn >= sensor.full_well_dn) {
    node.fail_at(black_level_key, number_text(sensor.black_level_dn) + " is out of range",
                 "at least 0 and below full_well_dn (" + number_text(sensor.full_well_dn) + ")");
  }
  return sensor;
}

}  // namespace brdfgate
