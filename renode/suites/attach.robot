*** Settings ***
Documentation     Parts of Renode on the buses and pins of this board. The core stands still; the suite writes the registers.
Library           ForceBoard.py

*** Test Cases ***
A Thermometer Of Renode's On I2C1
    Power Up Board
    Halt Core And Take I2C1
    Execute Command    machine LoadPlatformDescriptionFromString "thermometer: Sensors.TMP103 @ i2c1 0x71"
    Execute Command    thermometer Temperature 23
    I2C Should Read    0x71    00    17
    I2C Should Not Answer    0x72

A Thermometer Of Renode's Behind The Multiplexer
    Power Up Board
    Halt Core And Take I2C1
    Execute Command    machine LoadPlatformDescriptionFromString "outside: Sensors.AS6221 @ channel6 0x48"
    Execute Command    outside Temperature 25.5
    I2C Should Not Answer    0x48
    I2C Write    0x70    40
    # The pointer, a repeated START, and both bytes of the temperature: 25.5 in steps of 1/128.
    I2C Should Read    0x48    00    0CC0
    # A write of three bytes reaches the chip as one block.
    I2C Write    0x48    031234
    I2C Should Read    0x48    03    1234
    I2C Write    0x70    00
    I2C Should Not Answer    0x48

The Chips Of This Board Take The Time Of Their Bits
    Power Up Board
    Halt Core And Take I2C1
    # START, address, one byte, STOP: 20 bits of 2.5 us and a little.
    ${before}=    Now Ms
    I2C Write    0x70    01
    ${after}=    Now Ms
    Should Be True    0.05 < ${after} - ${before} < 0.2
    # The converter on channel 0, after its power-on.
    I2C Should Read    0x2A    00    00
    I2C Should Read    0x70    ${EMPTY}    01

A Loop Of Renode's On SPI1
    Power Up Board
    Halt Core And Take SPI1
    Execute Command    machine LoadPlatformDescriptionFromString "loop: SPI.SPILoopback @ spi1 6"
    ${answer}=    SPI Exchange    0xA55A
    Should Be Equal As Integers    ${answer}    0xA55A
    Execute Command    sysbus.spi1 Unregister sysbus.spi1.loop
    ${answer}=    SPI Exchange    0xA55A
    Should Be Equal As Integers    ${answer}    0

The Button Of The Board
    Power Up Board
    Execute Command    cpu IsHalted true
    # PC13 as an input.
    Poke    0x58020800    0xF3FFFFFF
    ${pins}=    Peek    0x58020810
    Should Be Equal As Integers    ${{int($pins) >> 13 & 1}}    0
    Execute Command    UserButton1 Press
    Advance    1
    ${pins}=    Peek    0x58020810
    Should Be Equal As Integers    ${{int($pins) >> 13 & 1}}    1
