"""What several test files share: contracts, toy worlds, peers for ROS, and browsers."""
