// The classes of assets (GenAssets, supplement, Table A1), from the words of the sources.
#pragma once
#include <string>

namespace cloam {

constexpr const char* kAssetClasses[] = {
    "Car", "Truck", "Bus", "Construction vehicle", "Emergency vehicle", "Bicycle", "Motorcycle", "Pedestrian", "Other"};
constexpr int kAssetClassCount = 9;

/// Index into kAssetClasses of a label of PandaSet or KITTI; "Other" for what neither Table A1 nor this list knows.
int asset_class(const std::string& label);

}  // namespace cloam
