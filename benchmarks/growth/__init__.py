"""What costs how much more as a service grows: each measurement at three sizes, the two largest tenfold apart."""
