#include "rosbag/bag_writer.hpp"

#include <geometry_msgs/PoseStamped.h>
#include <nav_msgs/Odometry.h>
#include <rosbag/bag.h>
#include <sensor_msgs/PointCloud2.h>

namespace cellmap::test {

struct BagWriter::Impl {
  rosbag::Bag bag;
};

BagWriter::BagWriter(const std::string& file, const std::string& compression)
    : impl_(std::make_unique<Impl>()) {
  impl_->bag.open(file, rosbag::bagmode::Write);
  impl_->bag.setCompression(compression == "bz2"   ? rosbag::compression::BZ2
                            : compression == "lz4" ? rosbag::compression::LZ4
                                                   : rosbag::compression::Uncompressed);
  impl_->bag.setChunkThreshold(4096);
}

BagWriter::~BagWriter() { impl_->bag.close(); }

void BagWriter::cloud(const std::string& topic, double received_s, const Cloud& cloud) {
  sensor_msgs::PointCloud2 message;
  message.header.stamp = ros::Time(cloud.stamp_s);
  message.header.frame_id = cloud.frame;
  message.height = cloud.height;
  message.width = cloud.width;
  for (const Cloud::Field& field : cloud.fields) {
    message.fields.emplace_back();
    message.fields.back().name = field.name;
    message.fields.back().offset = field.offset;
    message.fields.back().datatype = field.type;
    message.fields.back().count = 1;
  }
  message.is_bigendian = cloud.is_big_endian;
  message.point_step = cloud.point_step;
  message.row_step = cloud.row_step;
  message.data = cloud.data;
  impl_->bag.write(topic, ros::Time(received_s), message);
}

void BagWriter::odometry(const std::string& topic, double stamp_s, const std::string& child,
                         double x, double y, double z) {
  nav_msgs::Odometry message;
  message.header.stamp = ros::Time(stamp_s);
  message.header.frame_id = "odom";
  message.child_frame_id = child;
  message.pose.pose.position.x = x;
  message.pose.pose.position.y = y;
  message.pose.pose.position.z = z;
  message.pose.pose.orientation.w = 1;
  impl_->bag.write(topic, ros::Time(stamp_s), message);
}

void BagWriter::pose(const std::string& topic, double stamp_s, double x, double y, double z) {
  geometry_msgs::PoseStamped message;
  message.header.stamp = ros::Time(stamp_s);
  message.pose.position.x = x;
  message.pose.position.y = y;
  message.pose.position.z = z;
  message.pose.orientation.w = 1;
  impl_->bag.write(topic, ros::Time(stamp_s), message);
}

}  // namespace cellmap::test
