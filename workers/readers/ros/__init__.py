"""Files of topics: ROS bags, MCAP and Foxglove's own messages."""
