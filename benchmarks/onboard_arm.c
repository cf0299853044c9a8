/* For an ARM with a floating-point unit, under qemu-arm: what the last row gives. */
#include "onboard_rows.h"

#include <stdio.h>

int main(void) {
  shock_air air;
  int i;
  shock_begin(&state);
  for (i = 0; i < ROWS; i++) {
    shock_row row = row_of(i);
    shock_step(&state, &row, &air);
  }
  printf("state %u bytes, last row %.5f %.5f %.4f %.4f\n", (unsigned)sizeof(state), (double)air.temperature_c,
         (double)air.temperature_uncertainty_k, (double)air.humidity_percent, (double)air.humidity_uncertainty_percent);
  return 0;
}
