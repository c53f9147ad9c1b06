"""DEM: soil as particles."""
