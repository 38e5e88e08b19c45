/* For builds that list the sources of the vendor's package: libecan_igh_host has the functions. */
#include "igh_cia402_protocol.h"
