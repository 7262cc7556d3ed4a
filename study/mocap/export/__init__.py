"""Files of skeletons for other programs: points, tables, joint angles, hierarchies of bones."""
