/* For an ATmega1284P under simavr: cycles of a row by timer 1, and what the last row gives, on the serial port. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <stdio.h>

#include "onboard_rows.h"

static volatile uint32_t overflows;
ISR(TIMER1_OVF_vect) { overflows++; }

static int put(char c, FILE *stream) {
  (void)stream;
  UDR0 = c;
  return 0;
}
static FILE serial = FDEV_SETUP_STREAM(put, NULL, _FDEV_SETUP_WRITE);

static uint32_t now(void) {
  uint32_t high;
  uint16_t low;
  cli();
  low = TCNT1;
  high = overflows;
  if ((TIFR1 & 1) && low < 32768u) high++;
  sei();
  return (high << 16) | low;
}

int main(void) {
  uint32_t total = 0, most = 0;
  shock_air air;
  int i;
  stdout = &serial;
  UCSR0B = 8;
  TCCR1B = 1;
  TIMSK1 = 1;
  sei();
  shock_begin(&state);
  for (i = 0; i < ROWS; i++) {
    shock_row row = row_of(i);
    uint32_t before = now(), taken;
    shock_step(&state, &row, &air);
    taken = now() - before;
    if (i >= 5) total += taken;
    if (i >= 5 && taken > most) most = taken;
  }
  printf("state %u bytes, %lu cycles a row, at most %lu, last row %ld %ld e-5, %ld %ld e-4\n", (unsigned)sizeof(state),
         total / (ROWS - 5), most, (long)(air.temperature_c * 1e5f), (long)(air.temperature_uncertainty_k * 1e5f),
         (long)(air.humidity_percent * 1e4f), (long)(air.humidity_uncertainty_percent * 1e4f));
  cli();
  sleep_mode();
  return 0;
}
